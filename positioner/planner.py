"""The iterative LTV-QP predictive controller: Steps 1 to 5 of paper §4.1. Pure, but for the solver passed in.

The model is eq. 29 in steps of T_s (forward Euler), with the friction as an affine term (D5) and with sign(v) = 0
inside a dead zone (D7). In each pass the friction along the horizon is that of the last predicted trajectory.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar, Protocol

import numpy as np
from annotated_types import Interval

from positioner.qp import Horizon, Prediction, QuadraticProgram, predict, tracking_cost

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from positioner.bounds import Bounds
    from positioner.model import ValveParameters
    from positioner.solver import Solution


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannerSettings:
    """The `[control.planner]` table of a configuration (paper Table 5).

    prediction_steps, control_steps: H_p, H_u.
    error_weight_per_cm2, terminal_factor: Q per squared cm (D4), and the factor on its last entry (1 in the paper).
    input_weight_per_ma2: R per squared mA.
    max_passes, pass_tolerance_ma: when Step 5 ends.
    sign_dead_zone_m_per_s: speed below which the model has no Coulomb friction (D7).
    """

    __pydantic_config__: ClassVar = {"extra": "forbid", "allow_inf_nan": False}

    prediction_steps: Annotated[int, Interval(ge=2, le=100)] = 4
    control_steps: Annotated[int, Interval(ge=1, le=100)] = 4
    error_weight_per_cm2: Annotated[float, Interval(gt=0.0, le=1e6)] = 1.0
    terminal_factor: Annotated[float, Interval(ge=0.0, le=1e3)] = 1.0
    input_weight_per_ma2: Annotated[float, Interval(gt=0.0, le=1e3)] = 1e-5
    max_passes: Annotated[int, Interval(ge=1, le=50)] = 8
    pass_tolerance_ma: Annotated[float, Interval(gt=0.0, le=1.0)] = 1e-3
    sign_dead_zone_m_per_s: Annotated[float, Interval(ge=0.0, le=1.0)] = 0.0

    def __post_init__(self) -> None:
        """Refuse a control horizon beyond the prediction."""
        if self.control_steps > self.prediction_steps:
            raise ValueError("control_steps exceeds prediction_steps")


@dataclass(frozen=True, slots=True)
class Plan:
    """The optimal inputs U* (H_u,) in mA, the predicted states X (H_p, 2) in m and m/s, and the passes it took."""

    inputs_ma: NDArray[np.float64]
    states: NDArray[np.float64]
    passes: int
    converged: bool


class Solver(Protocol):
    """What the planner needs of a solver: see `positioner.solver.QpSolver`."""

    def solve(self, program: QuadraticProgram) -> Solution | None:
        """Return the solution of `program`, or None where there is none."""


def plan(
    settings: PlannerSettings,
    valve: ValveParameters,
    solver: Solver,
    start: tuple[float, float],
    setpoint_m: float,
    bounds: Bounds,
    inputs_ma: NDArray[np.float64],
    period_s: float,
) -> Plan | None:
    """Return the plan from the state `start` (m, m/s), or None when no programme on the way has a solution.

    inputs_ma (H_u,) is the first guess U(k): the last plan, shifted.
    """
    origin = np.array(start)
    for passes in range(1, settings.max_passes + 1):
        horizon = linearise(settings, valve, start, inputs_ma, period_s)  # Steps 1 to 3
        prediction = predict(horizon, origin, settings.control_steps)
        solution = solver.solve(program(settings, prediction, setpoint_m, bounds, valve, period_s))  # Step 4
        if solution is None:
            return None
        found = np.clip(solution.z, bounds.current_low_ma, bounds.current_high_ma)
        change = float(np.max(np.abs(found - inputs_ma)))
        inputs_ma = found
        if change < settings.pass_tolerance_ma:  # Step 5
            return Plan(inputs_ma, prediction.states(inputs_ma), passes, True)
    return Plan(inputs_ma, prediction.states(inputs_ma), passes, False)


def linearise(
    settings: PlannerSettings,
    valve: ValveParameters,
    start: tuple[float, float],
    inputs_ma: NDArray[np.float64],
    period_s: float,
) -> Horizon:
    """Return the model along the trajectory that `inputs_ma` (H_u,) drives from `start` (eqs 29, 30; D1, D5, D7)."""
    steps = settings.prediction_steps
    rate = period_s / valve.mass_kg
    stiffness, damping = -valve.spring_rate_n_per_m * rate, 1.0 - valve.viscous_friction_n_s_per_m * rate
    gain = valve.force_gain_n_per_ma * rate
    affine = np.zeros((steps, 2))
    x, v = start
    last = len(inputs_ma) - 1
    for i in range(steps):
        force = valve.kinetic_friction_n(v) * _sign(v, settings.sign_dead_zone_m_per_s)
        affine[i, 1] = -(force + valve.bench_set_n) * rate
        x, v = x + period_s * v, stiffness * x + damping * v + affine[i, 1] + gain * float(inputs_ma[min(i, last)])
    A = np.array([[1.0, period_s], [stiffness, damping]])
    return Horizon(np.broadcast_to(A, (steps, 2, 2)), np.broadcast_to([0.0, gain], (steps, 2)), affine)


def program(
    settings: PlannerSettings,
    prediction: Prediction,
    setpoint_m: float,
    bounds: Bounds,
    valve: ValveParameters,
    period_s: float,
) -> QuadraticProgram:
    """Return eq. 17 as a programme: rows are the H_u inputs, then the H_p speeds, both scaled to mA.

    The speed bound at a step is relaxed to what full braking reaches there (D10), so that a bound that moves inside
    the present speed leaves a programme with a solution: brake as hard as the loop can.
    """
    weight = np.full(settings.prediction_steps, settings.error_weight_per_cm2 * 1e4)
    weight[-1] *= settings.terminal_factor
    P, q = tracking_cost(prediction, setpoint_m, weight, settings.input_weight_per_ma2)
    low, high = bounds.current_low_ma, bounds.current_high_ma
    unit = valve.mass_kg / (valve.force_gain_n_per_ma * period_s)
    free, forced = prediction.free[:, 1] * unit, prediction.forced[:, 1, :] * unit
    reach = forced.sum(axis=1)
    speed_high = np.maximum(bounds.speed_high_m_per_s * unit, free + reach * low)
    speed_low = np.minimum(bounds.speed_low_m_per_s * unit, free + reach * high)
    count = settings.control_steps
    return QuadraticProgram(
        P,
        q,
        np.vstack([np.eye(count), forced]),
        np.concatenate([np.full(count, low), speed_low - free]),
        np.concatenate([np.full(count, high), speed_high - free]),
    )


def _sign(v: float, dead_zone: float) -> float:
    if abs(v) <= dead_zone:
        return 0.0
    return 1.0 if v > 0.0 else -1.0
