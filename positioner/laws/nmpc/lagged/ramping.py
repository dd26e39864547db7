"""The ramp: the pressure rises until the readings show that the stem has slipped. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.laws.nmpc.lagged.memory import Attempt, Ramp, Slipping
from positioner.laws.nmpc.lagged.onset import OnsetBank
from positioner.laws.nmpc.lagged.rest import LaggedRest
from positioner.laws.nmpc.lagged.slip_filter import SlipCovariance, SlipState
from positioner.values import replace

if TYPE_CHECKING:
    from positioner.laws.nmpc.lagged.belief import Belief
    from positioner.laws.nmpc.lagged.drive import Drive
    from positioner.laws.nmpc.lagged.memory import LaggedMemory, Move
    from positioner.laws.nmpc.lagged.onset import OnsetEstimate
    from positioner.laws.nmpc.lagged.pipeline import Pipeline
    from positioner.laws.nmpc.lagged.valve import LaggedValve

_PRESUMED = 2.0
"""The ramp begins so many standard deviations below the believed F_s, and grows faster as many above it."""
_GROWTH_S = 0.08
"""Time in which the rate of a ramp grows by e, once F_s is passed."""
_MOST_OF_STATIC, _BEYOND_S = 1.7, 0.05
"""A stem that so much of F_s does not free for so long is given up."""
_SMOOTHING = 0.25
_SLIPPED, _BACKWARD = 5.0, 6.0
"""Smoothed displacement, in its own σ, that shows a slip which no hypothesis explains; against the ramp, more."""
_SEEN = 1.0
"""A slip must be so much likelier by its readings, as a logarithm. On an unknown valve a force beyond the believed F_s
makes it probable without any."""
_LONGEST_S = 6.0
_AT_LIMIT_MA = 0.02
_SAME_MA = 2e-3
"""Pressures that differ by less are the same, after the rounding of a current in its frame."""


def begun(move: Move, rest: LaggedRest, pipeline: Pipeline) -> Ramp:
    """Return the ramp with which a move begins."""
    return Ramp(move, rest, OnsetBank(), pipeline.pressure_ma, move.rate_ma_per_s)


def later(valve: LaggedValve, memory: LaggedMemory, ramp: Ramp, before: Pipeline, after: Pipeline) -> Ramp:
    """Return the ramp one sample later, in which the pressure went from `before` to `after`."""
    belief, s = memory.belief, ramp.move.direction
    slip = valve.slip(belief, memory.drive, s)
    force_n = s * valve.model.net_n(after.pressure_ma, slip.spring_n_per_m, ramp.rest.x)
    bank = ramp.bank.advanced(slip, valve.sensor, before, after.acting_ma, ramp.rest.x, belief.doubt * slip.static_n)
    rest = ramp.rest.later(valve.sensor, valve.period_s)
    beyond_s = ramp.beyond_s + valve.period_s if force_n > _MOST_OF_STATIC * slip.static_n else 0.0
    return replace(ramp, bank=bank, rest=rest, peak_n=max(ramp.peak_n, force_n), beyond_s=beyond_s)


def read(
    valve: LaggedValve, memory: LaggedMemory, ramp: Ramp, measured_m: float, variance_m2: float, time_s: float
) -> LaggedMemory:
    """Return the memory after a reading: still on the ramp, sliding, or at rest where the ramp is given up."""
    move, rest, belief = ramp.move, ramp.rest, memory.belief
    s, seen_m = move.direction, measured_m - rest.x - rest.gap
    bank = ramp.bank.scored(seen_m, variance_m2 + rest.xx)
    probability = bank.probability()
    weight = 1.0 - probability
    spread = rest.xx + variance_m2
    gain = rest.xx / spread * weight
    rest = replace(rest, x=rest.x + gain * seen_m, xx=rest.xx * (1.0 - gain))
    shift_m = ramp.shift_m + _SMOOTHING * (measured_m - rest.x - rest.gap - ramp.shift_m)
    slow_m = ramp.slow_shift_m + _SMOOTHING * (shift_m - ramp.slow_shift_m)
    readings = ramp.readings + 1
    ramp = replace(ramp, rest=rest, bank=bank, shift_m=shift_m, slow_shift_m=slow_m, readings=readings)
    smooth_m = math.sqrt(variance_m2 * _SMOOTHING / (2.0 - _SMOOTHING))
    force_n = s * valve.model.net_n(memory.pipeline.pressure_ma, belief.onsets.spring_n_per_m, rest.x)
    enough = readings > _LEAST_READINGS
    if enough and s * shift_m < -(_BACKWARD * smooth_m + 4.0 * rest.sigma_m):
        there = LaggedRest(rest.x + shift_m, shift_m * shift_m, settle_s=_GIVEN_UP_S)
        return replace(memory, stem=there, attempt=None, is_final=True)
    if ramp.beyond_s > _BEYOND_S:
        return given_up(memory, ramp, measured_m, variance_m2, time_s)
    if enough and probability < _EVEN and s * shift_m > _SLIPPED * smooth_m + 3.0 * rest.sigma_m:
        return _unexplained(valve, memory, ramp, math.sqrt(variance_m2), force_n, time_s)
    if probability > valve.settings.verdict and bank.onsets and bank.most() > _SEEN:
        return _slipped(valve, memory, ramp, bank.summary(), force_n, time_s)
    return replace(memory, stem=ramp)


def given_up(memory: LaggedMemory, ramp: Ramp, measured_m: float, variance_m2: float, time_s: float) -> LaggedMemory:
    """Return the memory at rest, after a push that did not free the stem."""
    rest = LaggedRest(measured_m, variance_m2, settle_s=_GIVEN_UP_S)
    pushes = memory.pushes.after_push(moved=False, time_s=time_s, rest_m=ramp.rest.x, sigma_m=ramp.rest.sigma_m)
    return replace(memory, stem=rest, attempt=None, is_final=True, corrections=memory.corrections + 1, pushes=pushes)


def _slipped(
    valve: LaggedValve, memory: LaggedMemory, ramp: Ramp, onset: OnsetEstimate, force_n: float, time_s: float
) -> LaggedMemory:
    """Return the memory of a stem that slides, after an onset that the bank explains."""
    belief, rest, s = memory.belief, ramp.rest, ramp.move.direction
    nominal_n, onsets = valve.static_n, belief.onsets
    by_lag_n = valve.model.gain_n_per_ma * memory.pipeline.by_lag * memory.drive.fill_s / onsets.lag
    seen_n = onsets.spring_n_per_m * rest.x + s * onset.force_n
    rate2 = onsets.spring_n_per_m * onsets.spring_n_per_m * rest.xx
    doubt_n = 0.02 * onsets.static_n
    expected_n = onsets.spring_n_per_m * rest.x + s * onsets.static_n
    loose = onsets.loosened(0.003 * valve.spring_n_per_m, 0.01 * nominal_n, 0.01 if valve.has_lag else 0.0)
    start2 = _square(valve.model.gain_n_per_ma * memory.pipeline.doubt_ma)
    learned = loose.with_onset(rest.x, s, by_lag_n, seen_n, onset.ff + doubt_n * doubt_n + rate2 + start2)
    learned = valve.within(learned)
    error = abs(seen_n - expected_n) / onsets.static_n
    doubt = min(max(0.9 * belief.doubt + 0.13 * error, 0.03), 0.15)
    x, v = rest.x + onset.x, onset.v
    state = SlipState(
        x,
        v if s * v > 0.0 else s * 1e-3,
        min(learned.sliding_n, onset.force_n - 0.5 * valve.gap_n),
        rest.x + rest.gap + onset.seen,
        SlipCovariance(
            onset.xx + rest.xx,
            onset.xv,
            0.0,
            onset.xy + rest.xx,
            onset.vv,
            0.0,
            onset.vy,
            learned.slip_n2(ramp.move.middle_m, s, belief.scatter2),
            0.0,
            onset.yy + rest.xx,
        ),
    )
    after = replace(belief, onsets=learned, doubt=doubt, seen=belief.seen + 1)
    return _sliding(memory, ramp, state, onset.force_n, after, force_n, time_s)


def _unexplained(
    valve: LaggedValve, memory: LaggedMemory, ramp: Ramp, sigma_m: float, force_n: float, time_s: float
) -> LaggedMemory:
    """Return the memory of a stem that slides by its displacement, although no hypothesis explains it."""
    belief, rest, s = memory.belief, ramp.rest, ramp.move.direction
    speed = (ramp.shift_m - ramp.slow_shift_m) * _SMOOTHING / valve.period_s / (1.0 - _SMOOTHING)
    moved_m = 2.0 * ramp.shift_m - ramp.slow_shift_m
    lag_s = min(s * ramp.shift_m / max(abs(speed), 1e-3), 0.05) + 0.5 * valve.period_s / _SMOOTHING
    onset_n = force_n - valve.model.gain_n_per_ma * ramp.rate_ma_per_s * lag_s
    onsets = belief.onsets
    by_lag_n = valve.model.gain_n_per_ma * memory.pipeline.by_lag * memory.drive.fill_s / onsets.lag
    seen_n = onsets.spring_n_per_m * rest.x + s * onset_n
    loose = onsets.loosened(0.02 * valve.spring_n_per_m, 0.05 * valve.static_n, 0.03 if valve.has_lag else 0.0)
    rate2 = onsets.spring_n_per_m * onsets.spring_n_per_m * rest.xx
    start2 = _square(valve.model.gain_n_per_ma * memory.pipeline.doubt_ma)
    learned = loose.with_onset(rest.x, s, by_lag_n, seen_n, _square(0.08 * onsets.static_n) + rate2 + start2)
    learned = valve.within(learned)
    doubt2 = _square(0.5 * ramp.shift_m) + 0.3 * sigma_m * sigma_m
    state = SlipState(
        rest.x + moved_m,
        speed if s * speed > 0.0 else s * 1e-3,
        learned.sliding_n,
        rest.x + rest.gap + ramp.shift_m,
        SlipCovariance(
            doubt2,
            0.0,
            0.0,
            doubt2 if valve.sensor.left == 0.0 else 0.0,
            _square(0.5 * speed) + 1e-4,
            0.0,
            0.0,
            learned.slip_n2(ramp.move.middle_m, s, belief.scatter2),
            0.0,
            doubt2,
        ),
    )
    after = replace(belief, onsets=learned, doubt=min(1.2 * belief.doubt, 0.15))
    return _sliding(memory, ramp, state, max(force_n, 1.02 * belief.sliding_n), after, force_n, time_s)


def _sliding(
    memory: LaggedMemory,
    ramp: Ramp,
    state: SlipState,
    static_n: float,
    belief: Belief,
    force_n: float,
    time_s: float,
) -> LaggedMemory:
    drive, before = memory.drive, memory.belief.onsets
    if belief.onsets.lag != before.lag:
        drive = drive.with_lag(belief.onsets.lag / before.lag)
    attempt = Attempt(ramp.move, before, max(ramp.peak_n, force_n), before.spring_n_per_m)
    slipping = Slipping(ramp.move, state, static_n, time_s)
    return replace(memory, stem=slipping, belief=belief, drive=drive, attempt=attempt)


def command(valve: LaggedValve, memory: LaggedMemory, ramp: Ramp) -> tuple[Ramp, float]:
    """Return the ramp and its current: to the foot of the ramp at once, then the pressure rises steadily."""
    move, belief, drive = ramp.move, memory.belief, memory.drive
    s, period_s, onsets = move.direction, valve.period_s, belief.onsets
    spring_n, margin = onsets.spring_n_per_m * ramp.rest.x, _PRESUMED * belief.doubt
    foot_ma = valve.model.pressure_ma(spring_n + s * onsets.static_n * (1.0 - margin))
    pressure_ma, converter_ma = after_pending(memory.pipeline, drive)
    if s * (foot_ma - pressure_ma) > max(ramp.rate_ma_per_s * period_s, _SAME_MA):
        return replace(ramp, reference_ma=foot_ma), drive.command_ma(pressure_ma, converter_ma, foot_ma)
    rate = ramp.rate_ma_per_s
    now_n = s * valve.model.net_n(memory.pipeline.pressure_ma, onsets.spring_n_per_m, ramp.rest.x)
    if now_n > onsets.static_n * (1.0 + margin):
        rate *= 1.0 + period_s / _GROWTH_S
    step_ma = s * rate * period_s
    reference_ma = ramp.reference_ma + step_ma
    if s * (pressure_ma - reference_ma) > 0.0:
        reference_ma = pressure_ma + step_ma
    current_ma = drive.command_ma(pressure_ma, converter_ma, reference_ma)
    return replace(ramp, reference_ma=reference_ma, rate_ma_per_s=rate), current_ma


def is_hopeless(ramp: Ramp, pipeline: Pipeline, drive: Drive, current_ma: float, time_s: float) -> bool:
    """Return whether the ramp lasts too long, or the loop can give no more and the pressure has got there."""
    if time_s - ramp.move.began_s > _LONGEST_S + 5.0 * drive.fill_s:
        return True
    limit_ma = drive.high_ma if ramp.move.direction > 0.0 else drive.low_ma
    return current_ma == limit_ma and abs(pipeline.pressure_ma - limit_ma) < _AT_LIMIT_MA


def after_pending(pipeline: Pipeline, drive: Drive) -> tuple[float, float]:
    """Return pressure and converter output when the next command begins to act."""
    pressure_ma, converter_ma = pipeline.pressure_ma, pipeline.converter_ma
    for current_ma in pipeline.pending():
        pressure_ma, converter_ma = drive.after(pressure_ma, converter_ma, current_ma)
    return pressure_ma, converter_ma


def _square(value: float) -> float:
    return value * value


_LEAST_READINGS = 5
_EVEN = 0.5
"""A probability below it favours a stem that sticks."""
_GIVEN_UP_S = 0.01
