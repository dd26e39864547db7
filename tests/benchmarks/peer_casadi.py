"""CasADi: sqpmethod with qrqp, and Opti with IPOPT; both by multiple shooting, as its examples do."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import casadi
import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from benchmarks.problem import ControlProblem

    Array = NDArray[np.float64]


class Sqp:
    """`nlpsol` with sqpmethod: a problem whose first quadratic programme is the whole problem."""

    def __init__(self, steps: int) -> None:
        self._steps = steps
        symbol = casadi.SX.sym
        states, inputs = symbol("x", 2, steps), symbol("u", steps)
        A, b, g = symbol("A", 4, steps), symbol("b", 2, steps), symbol("g", 2, steps)
        errors, targets, weights, factor = symbol("e", steps), symbol("t", steps), symbol("w", steps), symbol("r")
        motion, stops, state = [], [], casadi.SX.zeros(2)
        for i in range(steps):
            following = casadi.reshape(A[:, i], 2, 2).T @ state + b[:, i] * inputs[i]
            motion.append(states[:, i] - following)
            state = states[:, i]
            stops.append(casadi.dot(g[:, i], state))
        cost = casadi.dot(weights, (states[0, :].T - errors) ** 2) + factor * casadi.sumsqr(inputs - targets)
        parameters = casadi.vertcat(*map(casadi.vec, (A, b, g, errors, targets, weights, factor)))
        problem = {
            "x": casadi.vertcat(inputs, casadi.vec(states)),
            "f": cost,
            "g": casadi.vertcat(*motion, *stops),
            "p": parameters,
        }
        quiet = {"print_time": False, "print_header": False, "print_iteration": False, "print_status": False}
        options: Any = {**quiet, "qpsol": "qrqp", "qpsol_options": {"print_iter": False, "print_header": False}}
        self._solve = casadi.nlpsol("solver", "sqpmethod", problem, options)
        self._last: dict[str, Any] = {"x0": np.zeros(3 * steps)}

    def solve(self, problem: ControlProblem) -> Array:
        """Return the inputs (N,) in mA."""
        free = np.full(2 * self._steps, np.inf)
        none = np.zeros(2 * self._steps)
        parts = (problem.A, problem.b, problem.g, problem.errors, problem.targets, problem.weights)
        found = self._solve(
            **self._last,
            p=np.concatenate([*map(np.ravel, parts), [problem.input_weight]]),
            lbx=np.concatenate([problem.low, -free]),
            ubx=np.concatenate([problem.high, free]),
            lbg=np.concatenate([none, np.full(self._steps, -np.inf)]),
            ubg=np.concatenate([none, problem.room]),
        )
        self._last = {"x0": found["x"], "lam_x0": found["lam_x"], "lam_g0": found["lam_g"]}
        inputs: Array = np.array(found["x"][: self._steps]).ravel()
        return inputs


class OptiIpopt:
    """`Opti` with IPOPT, with its default tolerance."""

    def __init__(self, steps: int) -> None:
        opti = self._opti = casadi.Opti()
        self._states, self._inputs = opti.variable(2, steps), opti.variable(steps)
        self._A, self._b, self._g = opti.parameter(4, steps), opti.parameter(2, steps), opti.parameter(2, steps)
        self._errors, self._targets, self._weights = (opti.parameter(steps) for _ in range(3))
        self._factor, self._room = opti.parameter(), opti.parameter(steps)
        self._low, self._high = opti.parameter(steps), opti.parameter(steps)
        state = casadi.MX.zeros(2)
        for i in range(steps):
            following = casadi.reshape(self._A[:, i], 2, 2).T @ state + self._b[:, i] * self._inputs[i]
            state = self._states[:, i]
            opti.subject_to(state == following)
            opti.subject_to(casadi.dot(self._g[:, i], state) <= self._room[i])
        opti.subject_to(opti.bounded(self._low, self._inputs, self._high))
        tracked = casadi.dot(self._weights, (self._states[0, :].T - self._errors) ** 2)
        opti.minimize(tracked + self._factor * casadi.sumsqr(self._inputs - self._targets))
        quiet: Any = {"print_level": 0, "sb": "yes"}
        opti.solver("ipopt", {"print_time": False, "expand": True}, quiet)

    def solve(self, problem: ControlProblem) -> Array:
        """Return the inputs (N,) in mA."""
        opti = self._opti
        opti.set_value(self._A, problem.A.reshape(-1, 4).T)
        opti.set_value(self._b, problem.b.T)
        opti.set_value(self._g, problem.g.T)
        opti.set_value(self._errors, problem.errors)
        opti.set_value(self._targets, problem.targets)
        opti.set_value(self._weights, problem.weights)
        opti.set_value(self._factor, problem.input_weight)
        opti.set_value(self._room, problem.room)
        opti.set_value(self._low, problem.low)
        opti.set_value(self._high, problem.high)
        solution = opti.solve()
        opti.set_initial(solution.value_variables())
        inputs: Array = np.array(solution.value(self._inputs))
        return inputs
