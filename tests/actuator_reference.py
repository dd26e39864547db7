"""Actuator and sliding stem once more, as differential equations for an integrator that knows no closed form."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from scipy.integrate import solve_ivp

from positioner.valve.actuator import ActuatorParameters

if TYPE_CHECKING:
    from positioner.valve.motion import Load, MotionModel


def actuator_of(fill_s: float, ratio: float, converter_s: float, slew: float) -> ActuatorParameters:
    """Return an actuator whose vent lag is `ratio` times its fill lag; `slew` in mA/s, 0 for none."""
    return ActuatorParameters(
        fill_time_constant_s=fill_s,
        vent_time_constant_s=ratio * fill_s,
        converter_time_constant_s=converter_s,
        slew_ma_per_s=slew,
    )


class Moving(NamedTuple):
    """x (m), v (m/s), p and w (mA), and whether the stem has stopped."""

    x: float
    v: float
    p: float
    w: float
    stopped: bool = False


def pressure_rate(actuator: ActuatorParameters, p: float, w: float) -> float:
    """Return ṗ in mA/s."""
    lag_s = actuator.fill_time_constant_s if w > p else actuator.vent_time_constant_s
    most = actuator.slew_ma_per_s or math.inf
    return min(max((w - p) / max(lag_s, 1e-6), -most), most)


def moved(
    model: MotionModel, load: Load, actuator: ActuatorParameters, s: float, start: Moving, u: float, duration_s: float
) -> Moving:
    """Return the state after `duration_s` under the current `u`; without any lag the pressure is `u` at once."""
    converter_s = actuator.converter_time_constant_s
    is_immediate = not actuator.fill_time_constant_s and not actuator.slew_ma_per_s and not converter_s

    def rates(_t: float, state: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
        x, v, p, w = state
        force_n = model.gain_n_per_ma * p - model.bench_set_n - s * load.friction_n - load.spring_n_per_m * x
        acceleration = (force_n - load.viscous_n_s_per_m * v) / model.mass_kg
        dp = 0.0 if is_immediate else pressure_rate(actuator, p, w if converter_s else u)
        dw = (u - w) / converter_s if converter_s else 0.0
        return (0.0, 0.0, dp, dw) if start.stopped else (v, acceleration, dp, dw)

    def stop(_t: float, state: tuple[float, float, float, float]) -> float:
        return s * state[1]

    stop.terminal = True  # type: ignore[attr-defined]
    stop.direction = -1.0  # type: ignore[attr-defined]
    lag_s = actuator.fill_time_constant_s or 1.0
    is_stiff = lag_s < duration_s / 20.0 or load.viscous_n_s_per_m * duration_s > 20.0 * model.mass_kg
    p = u if is_immediate else start.p
    run = solve_ivp(
        rates,
        (0.0, duration_s),
        (start.x, start.v, p, start.w if converter_s else u),
        method="Radau" if is_stiff else "DOP853",
        rtol=1e-9,
        atol=(1e-13, 1e-11, 1e-10, 1e-10),
        events=None if start.stopped else stop,
        max_step=duration_s / 4.0,
    )
    assert run.success
    x, v, p, w = (float(value) for value in run.y[:, -1])
    if run.status != 1:
        return Moving(x, v, p, w, start.stopped)
    at_rest = Moving(x, 0.0, p, w, stopped=True)
    left_s = duration_s - float(run.t[-1])
    return moved(model, load, actuator, s, at_rest, u, left_s) if left_s > 1e-9 else at_rest
