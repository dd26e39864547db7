"""do-mpc: a discrete model with time-varying parameters, and IPOPT."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from do_mpc.controller import MPC
from do_mpc.model import Model

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from benchmarks.problem import ControlProblem

    Array = NDArray[np.float64]

_ONE = (1, 1)
_GIVEN = {"A": (2, 2), "b": (2, 1), "error": _ONE, "weight": _ONE, "target": _ONE, "factor": _ONE, "g": (1, 2)} | {
    "room": _ONE
}
"""The time-varying parameters."""


class DoMpc:
    """An MPC of do-mpc; each step of it starts from the solution of the last one."""

    def __init__(self, steps: int) -> None:
        model = Model("discrete", "SX")
        model.set_variable("_x", "state", shape=(2, 1))
        model.set_variable("_u", "u")
        for name, shape in _GIVEN.items():
            model.set_variable("_tvp", name, shape=shape)
        model.set_rhs("state", _following(model))
        model.setup()
        mpc = self._mpc = MPC(model)
        mpc.settings.n_horizon = steps
        mpc.settings.t_step = 1.0
        mpc.settings.n_robust = 0
        mpc.settings.store_full_solution = False
        mpc.settings.supress_ipopt_output()
        given, state, u = model.tvp, model.x["state"], model.u["u"]
        tracked = given["weight"] * (state[0] - given["error"]) ** 2
        mpc.set_objective(mterm=tracked, lterm=tracked + given["factor"] * (u - given["target"]) ** 2)
        mpc.set_nl_cons("stop", given["g"] @ _following(model) - given["room"], ub=0.0)
        self._template = mpc.get_tvp_template()
        mpc.set_tvp_fun(lambda _now: self._template)
        mpc.setup()
        mpc.x0 = np.zeros(2)
        mpc.set_initial_guess()
        self._steps = steps

    def solve(self, problem: ControlProblem) -> Array:
        """Return the first input (1,) in mA."""
        errors, weights = np.concatenate([[0.0], problem.errors]), np.concatenate([[0.0], problem.weights])
        # the model after the last input is in no equation, but needs values
        last = [*range(self._steps), self._steps - 1]
        factor = np.full(len(last), problem.input_weight)
        columns = (
            problem.A.transpose(0, 2, 1).reshape(-1, 4)[last],  # column by column
            problem.b[last],
            errors[:, np.newaxis],
            weights[:, np.newaxis],
            problem.targets[last][:, np.newaxis],
            factor[:, np.newaxis],
            problem.g[last],
            problem.room[last][:, np.newaxis],
        )
        self._template["_tvp", :] = list(np.hstack(columns))
        mpc: Any = self._mpc
        mpc.lb_opt_x["_u", :, 0] = list(problem.low)
        mpc.ub_opt_x["_u", :, 0] = list(problem.high)
        found: Array = mpc.make_step(np.zeros((2, 1)))
        return found.ravel()


def _following(model: Any) -> Any:
    return model.tvp["A"] @ model.x["state"] + model.tvp["b"] * model.u["u"]
