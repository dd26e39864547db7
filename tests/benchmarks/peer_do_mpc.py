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

_GIVEN = ("g", "weight", "down", "up")
"""The time-varying parameters."""


class DoMpc:
    """An MPC of do-mpc; each step of it starts from the solution of the last one."""

    def __init__(self, steps: int) -> None:
        model = Model("discrete", "SX")
        error, last, u = (
            model.set_variable("_x", "error"),
            model.set_variable("_x", "last"),
            model.set_variable("_u", "u"),
        )
        g, weight, down, up = (model.set_variable("_tvp", name) for name in _GIVEN)
        model.set_rhs("error", error + g * u)
        model.set_rhs("last", u)
        model.setup()
        mpc = self._mpc = MPC(model)
        mpc.settings.n_horizon = steps
        mpc.settings.t_step = 1.0
        mpc.settings.n_robust = 0
        mpc.settings.store_full_solution = False
        mpc.settings.supress_ipopt_output()
        mpc.set_objective(mterm=0.5 * weight * error**2, lterm=0.5 * u**2)
        mpc.set_nl_cons("least", down - (u - last), ub=0.0)
        mpc.set_nl_cons("most", (u - last) - up, ub=0.0)
        self._template = mpc.get_tvp_template()
        mpc.set_tvp_fun(lambda _now: self._template)
        mpc.setup()
        mpc.x0 = np.zeros(2)
        mpc.set_initial_guess()
        self._steps = steps

    def solve(self, problem: ControlProblem) -> Array:
        """Return the first input (1,) in mA."""
        # the model after the last input is in no equation, but needs values
        last = [*range(self._steps), self._steps - 1]
        weight = np.full(len(last), problem.weight)
        self._template["_tvp", :] = list(
            np.column_stack((problem.g[last], weight, problem.down[last], problem.up[last]))
        )
        mpc: Any = self._mpc
        mpc.lb_opt_x["_u", :, 0] = list(problem.low)
        mpc.ub_opt_x["_u", :, 0] = list(problem.high)
        found: Array = mpc.make_step(np.array([[problem.error], [0.0]]))
        return found.ravel()
