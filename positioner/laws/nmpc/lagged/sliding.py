"""The slip: where the stem is, until friction has stopped it, and the current that stops it at its target. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.laws.nmpc.lagged.brake import stopping_current_ma
from positioner.laws.nmpc.lagged.rest import LaggedRest
from positioner.laws.nmpc.lagged.slip import Slip
from positioner.laws.nmpc.lagged.slip_filter import advanced
from positioner.values import replace

if TYPE_CHECKING:
    from positioner.laws.nmpc.lagged.memory import LaggedMemory, Slipping
    from positioner.laws.nmpc.lagged.pipeline import Pipeline
    from positioner.laws.nmpc.lagged.slip_filter import SlipState
    from positioner.laws.nmpc.lagged.valve import LaggedValve

_SLOW_SAMPLES = 4
_LEAST_RATIO = 1.005


def _motion(valve: LaggedValve, memory: LaggedMemory, slipping: Slipping) -> Slip:
    """Return the motion against the present estimate of F_c."""
    onsets, sliding_n = memory.belief.onsets, slipping.state.sliding_n
    static_n = max(onsets.static_n, _LEAST_RATIO * sliding_n)
    return Slip(valve.model, memory.drive, slipping.move.direction, onsets.spring_n_per_m, static_n, sliding_n)


def later(
    valve: LaggedValve, memory: LaggedMemory, slipping: Slipping, before: Pipeline, after: Pipeline, sigma_m: float
) -> LaggedMemory:
    """Return the memory one sample later, in which the pressure went from `before` to `after`."""
    own, slip = valve.settings, _motion(valve, memory, slipping)
    wander_n = own.friction_per_m * slipping.state.sliding_n
    state, stopped = advanced(slipping.state, slip, valve.sensor, before, after.acting_ma, own.force_noise_n, wander_n)
    if stopped:
        attempt = None if memory.attempt is None else replace(memory.attempt, landing=state)
        return replace(memory, stem=landed(valve, state, sigma_m), attempt=attempt, pipeline=after)
    return replace(memory, stem=replace(slipping, state=state), pipeline=after)


def landed(valve: LaggedValve, state: SlipState, sigma_m: float) -> LaggedRest:
    """Return the rest of a stem that the model has stopped; its place is less certain than the model says."""
    p = state.covariance
    doubt_m = valve.settings.landing_share * valve.gap_n / valve.spring_n_per_m * (2.0 if sigma_m > _NOISY_M else 1.0)
    settle_s = valve.settings.settle_s + valve.period_s * (1 + valve.delay_samples)
    return LaggedRest(
        state.x,
        p.xx + doubt_m * doubt_m,
        state.seen - state.x,
        p.xy - p.xx,
        max(p.yy - 2.0 * p.xy + p.xx, 0.0),
        settle_s=settle_s,
    )


_NOISY_M = 3e-4


def read(
    valve: LaggedValve, memory: LaggedMemory, slipping: Slipping, measured_m: float, variance_m2: float, time_s: float
) -> LaggedMemory:
    """Return the memory after a reading of a sliding stem."""
    s = slipping.move.direction
    state = slipping.state.corrected(measured_m, variance_m2, s)
    slow = slipping.slow + 1 if s * state.v < valve.slowest_m_per_s else 0
    most_n = max(slipping.static_n, memory.belief.onsets.static_n) - 0.4 * valve.gap_n
    state = replace(state, sliding_n=min(max(state.sliding_n, 0.5 * valve.sliding_n), 1.5 * valve.sliding_n, most_n))
    if slow >= _SLOW_SAMPLES or time_s - slipping.began_s > valve.longest_slip_s:
        rest = LaggedRest(state.x, _LOST_M * _LOST_M, settle_s=valve.settings.settle_s)
        return replace(memory, stem=rest)
    return replace(memory, stem=replace(slipping, state=state, slow=slow))


_LOST_M = 5e-4


def command(valve: LaggedValve, memory: LaggedMemory, slipping: Slipping) -> float:
    """Return the current that stops the stem at its target, the one that brakes where it is to stop sooner."""
    move, drive, own = slipping.move, memory.drive, valve.settings
    slip, s = _motion(valve, memory, slipping), move.direction
    brake_ma = valve.model.pressure_ma(slip.spring_n_per_m * move.aim_m - s * own.brake_share * slip.static_n)
    brake_ma = drive.limited(brake_ma)
    hardest_n = slip.spring_n_per_m * move.aim_m - s * own.brake_limit * slip.sliding_n
    hardest_ma = drive.limited(valve.model.pressure_ma(hardest_n))
    x, v, pipeline = slipping.state.x, slipping.state.v, memory.pipeline
    pressure_ma, converter_ma = pipeline.pressure_ma, pipeline.converter_ma
    stopped = False
    for current_ma in pipeline.pending():
        if stopped:
            pressure_ma, converter_ma = drive.after(pressure_ma, converter_ma, current_ma)
        else:
            x, v, pressure_ma, converter_ma, stopped = slip.after(x, v, pressure_ma, converter_ma, current_ma)
    if stopped:
        return drive.command_ma(pressure_ma, converter_ma, brake_ma)
    return stopping_current_ma(
        slip,
        x,
        v,
        pressure_ma,
        converter_ma,
        move.aim_m,
        brake_ma,
        hardest_ma,
        own.fastest_m_per_s,
        own.brake_reserve,
        own.slew_reserve,
    )
