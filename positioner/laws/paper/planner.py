"""The iterative LTV-QP predictive controller: Steps 1 to 5 of paper §4.1. Pure, but for the solver passed in.

The model is eq. 29 in steps of T_s (forward Euler), with the friction as an affine term (D5) and with sign(v) = 0
inside a dead zone (D7). In each pass the friction along the horizon is that of the last predicted trajectory.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Annotated

import numpy as np
from annotated_types import Interval

from positioner.inputs.table import SettingsTable
from positioner.optimization.qp import QuadraticProgram, forced_response, packed, tracking_cost

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from positioner.laws.bounds import Bounds
    from positioner.optimization.qp import Solver
    from positioner.valve.parameters import ValveParameters


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannerSettings(SettingsTable):
    """The `[control.planner]` table of a configuration (paper Table 5).

    prediction_steps, control_steps: H_p, H_u, the horizons in sample periods.
    error_weight_per_cm2: Q, weight of an error in squared cm (D4).
    terminal_factor: factor on the last entry of Q (1 in the paper).
    input_weight_per_ma2: R, weight of a current in squared mA.
    max_passes: largest number of successive linearisations.
    pass_tolerance_ma: they end when the plan changes by less (Step 5).
    sign_dead_zone_m_per_s: speed below which the model has no Coulomb friction (D7).
    """

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
    """The optimal inputs U* (H_u,) in mA, and the number of passes to them."""

    inputs_ma: NDArray[np.float64]
    passes: int


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
    """Return the plan from the state `start` (m, m/s), or None when a programme on the way has no solution.

    inputs_ma (H_u,) is the first guess U(k): the last plan, shifted.
    """
    fixed = condense(settings, valve, period_s)
    free = free_response(settings, valve, start, inputs_ma, period_s)  # Steps 1 to 3
    passes, has_converged = 0, False
    while not has_converged and passes < settings.max_passes:
        solution = solver.solve(program(fixed, free, setpoint_m, bounds))  # Step 4
        if solution is None:
            return None
        found = np.clip(solution, bounds.current_low_ma, bounds.current_high_ma)
        change = float(np.abs(found - inputs_ma).max())
        linearised_at, inputs_ma = free, found
        free = free_response(settings, valve, start, inputs_ma, period_s)
        passes += 1
        # Step 5; the same linear model again would only give the same inputs again
        has_converged = change < settings.pass_tolerance_ma or np.array_equal(free, linearised_at)
    return Plan(inputs_ma, passes)


@dataclass(frozen=True, slots=True)
class Condensed:
    """The constant part of the programme: with the friction as an affine term, A and B of eq. 30 are constant (D5).

    P and A: of the `QuadraticProgram`, its outputs the speeds in mA. gradient (H_u, H_p): the cost is
    ½ z'Pz - z' gradient (r - free position).
    speed_unit: mA that one m/s is worth, B·T_s/m inverted. reach (H_p,): speeds under 1 mA held, in mA.
    """

    P: tuple[float, ...]
    A: tuple[float, ...]
    gradient: NDArray[np.float64]
    speed_unit: float
    reach: NDArray[np.float64]


@lru_cache(maxsize=16)
def condense(settings: PlannerSettings, valve: ValveParameters, period_s: float) -> Condensed:
    """Return the constant part of the programme (eqs 17, 19, 30; D3, D4)."""
    steps, count = settings.prediction_steps, settings.control_steps
    rate = period_s / valve.mass_kg
    gain = valve.force_gain_n_per_ma * rate
    A = np.array(
        [
            [1.0, period_s],
            [-valve.spring_rate_n_per_m * rate, 1.0 - valve.viscous_friction_n_s_per_m * rate],
        ]
    )
    forced = forced_response(A, np.array([0.0, gain]), steps, count)
    weight = np.full(steps, settings.error_weight_per_cm2 * 1e4)
    weight[-1] *= settings.terminal_factor
    P, gradient = tracking_cost(forced[:, 0, :], weight, settings.input_weight_per_ma2)
    speeds = forced[:, 1, :] / gain
    return Condensed(*packed(P, speeds), gradient, 1.0 / gain, speeds.sum(axis=1))


def free_response(
    settings: PlannerSettings,
    valve: ValveParameters,
    start: tuple[float, float],
    inputs_ma: NDArray[np.float64],
    period_s: float,
) -> NDArray[np.float64]:
    """Return the states (H_p, 2) without input, the friction being that along the trajectory under `inputs_ma`.

    Eqs 29 and 30 with D1, D5 and D7: two trajectories run side by side, the one that decides the signs of the speed,
    and the one without input that the programme needs.
    """
    rate = period_s / valve.mass_kg
    stiffness, damping = -valve.spring_rate_n_per_m * rate, 1.0 - valve.viscous_friction_n_s_per_m * rate
    gain = valve.force_gain_n_per_ma * rate
    inputs = inputs_ma.tolist()
    inputs += [inputs[-1]] * (settings.prediction_steps - len(inputs))
    free = np.empty((settings.prediction_steps, 2))
    (x, v), (free_x, free_v) = start, start
    for i, u in enumerate(inputs):
        force = valve.kinetic_friction_n(v) * _sign(v, settings.sign_dead_zone_m_per_s)
        affine = -(force + valve.bench_set_n) * rate
        x, v = x + period_s * v, stiffness * x + damping * v + affine + gain * u
        free_x, free_v = free_x + period_s * free_v, stiffness * free_x + damping * free_v + affine
        free[i, 0], free[i, 1] = free_x, free_v
    return free


def program(fixed: Condensed, free: NDArray[np.float64], setpoint_m: float, bounds: Bounds) -> QuadraticProgram:
    """Return eq. 17 as a programme: rows are the H_u inputs, then the H_p speeds, both in mA.

    The speed bound at a step is relaxed to what full braking reaches there (D10), so that a bound that moves inside
    the present speed leaves a programme with a solution: brake as hard as the loop can.
    """
    low, high = bounds.current_low_ma, bounds.current_high_ma
    speeds = free[:, 1] * fixed.speed_unit
    count = len(fixed.gradient)
    lower = np.minimum(bounds.speed_low_m_per_s * fixed.speed_unit - speeds, fixed.reach * high)
    upper = np.maximum(bounds.speed_high_m_per_s * fixed.speed_unit - speeds, fixed.reach * low)
    q = -fixed.gradient @ (setpoint_m - free[:, 0])
    return QuadraticProgram(
        fixed.P, q.tolist(), fixed.A, [low] * count + lower.tolist(), [high] * count + upper.tolist()
    )


def _sign(v: float, dead_zone: float) -> float:
    if abs(v) <= dead_zone:
        return 0.0
    return 1.0 if v > 0.0 else -1.0
