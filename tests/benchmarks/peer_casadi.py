"""CasADi: the active-set method of qpOASES, and Opti with IPOPT; both by multiple shooting, as its examples do."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import casadi
import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from benchmarks.problem import ControlProblem

    Array = NDArray[np.float64]


class Qpoases:
    """`qpsol` with qpOASES; its states are the errors of the stop."""

    def __init__(self, steps: int) -> None:
        symbol = casadi.SX.sym
        states, inputs = symbol("e", steps), symbol("u", steps)
        g, error, weight = symbol("g", steps), symbol("e0"), symbol("w")
        before = casadi.vertcat(error, states[:-1])
        changes = inputs - casadi.vertcat(0.0, inputs[:-1])
        problem = {
            "x": casadi.vertcat(inputs, states),
            "f": 0.5 * weight * states[-1] ** 2 + 0.5 * casadi.sumsqr(inputs),
            "g": casadi.vertcat(states - before - g * inputs, changes),
            "p": casadi.vertcat(g, error, weight),
        }
        options: Any = {"print_time": False, "printLevel": "none"}
        self._solve, self._steps = casadi.qpsol("solver", "qpoases", problem, options), steps
        self._last: dict[str, Any] = {"x0": np.zeros(2 * steps)}

    def solve(self, problem: ControlProblem) -> Array:
        """Return the inputs (N,) in mA."""
        none, free = np.zeros(self._steps), np.full(self._steps, np.inf)
        found = self._solve(
            **self._last,
            p=np.concatenate([problem.g, [problem.error, problem.weight]]),
            lbx=np.concatenate([problem.low, -free]),
            ubx=np.concatenate([problem.high, free]),
            lbg=np.concatenate([none, problem.down]),
            ubg=np.concatenate([none, problem.up]),
        )
        self._last = {"x0": found["x"], "lam_x0": found["lam_x"], "lam_g0": found["lam_g"]}
        inputs: Array = np.array(found["x"][: self._steps]).ravel()
        return inputs


class OptiIpopt:
    """`Opti` with IPOPT, with its default tolerance."""

    def __init__(self, steps: int) -> None:
        opti = self._opti = casadi.Opti()
        states, self._inputs = opti.variable(steps), opti.variable(steps)
        self._g, self._error, self._weight = opti.parameter(steps), opti.parameter(), opti.parameter()
        self._low, self._high, self._down, self._up = (opti.parameter(steps) for _ in range(4))
        before = casadi.vertcat(self._error, states[:-1])
        opti.subject_to(states == before + self._g * self._inputs)
        opti.subject_to(opti.bounded(self._low, self._inputs, self._high))
        changes = self._inputs - casadi.vertcat(0.0, self._inputs[:-1])
        opti.subject_to(opti.bounded(self._down, changes, self._up))
        opti.minimize(0.5 * self._weight * states[-1] ** 2 + 0.5 * casadi.sumsqr(self._inputs))
        quiet: Any = {"print_level": 0, "sb": "yes"}
        opti.solver("ipopt", {"print_time": False, "expand": True}, quiet)

    def solve(self, problem: ControlProblem) -> Array:
        """Return the inputs (N,) in mA."""
        opti = self._opti
        opti.set_value(self._g, problem.g)
        opti.set_value(self._error, problem.error)
        opti.set_value(self._weight, problem.weight)
        opti.set_value(self._low, problem.low)
        opti.set_value(self._high, problem.high)
        opti.set_value(self._down, problem.down)
        opti.set_value(self._up, problem.up)
        solution = opti.solve()
        opti.set_initial(solution.value_variables())
        inputs: Array = np.array(solution.value(self._inputs))
        return inputs
