"""What the end of a move teaches: its landing bias, or that it never happened. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.laws.nmpc.lagged.sliding_friction import after_slip
from positioner.values import replace

if TYPE_CHECKING:
    from positioner.laws.nmpc.lagged.belief import Belief
    from positioner.laws.nmpc.lagged.memory import Attempt, LaggedMemory, Move
    from positioner.laws.nmpc.lagged.rest import LaggedRest
    from positioner.laws.nmpc.lagged.slip_filter import SlipState
    from positioner.laws.nmpc.lagged.valve import LaggedValve

_HAPPENED = 0.25
"""A stem that moved less than this part of the way has not been moved by the plan."""
_MOST_OF_JUMP = 0.28
"""Of the natural jump: the largest landing bias."""
_CERTAIN_M = 1.5e-4
"""A landing whose place was less certain than this teaches less of the bias."""
_MODEL = 0.02
"""What the model itself errs in a landing, as a part of the natural jump."""


def judged(valve: LaggedValve, memory: LaggedMemory, rest: LaggedRest) -> LaggedMemory:
    """Return the memory after the last move is judged by where the stem came to rest."""
    attempt = memory.attempt
    if attempt is None:
        return memory
    move = attempt.move
    s, planned_m = move.direction, abs(move.target_m - move.origin_m)
    moved_m = s * (rest.x - move.origin_m)
    if moved_m < _HAPPENED * planned_m and planned_m > 3.0 * rest.sigma_m:
        belief = _undone(valve, memory.belief, attempt)
        drive = memory.drive
        if belief.onsets.lag != memory.belief.onsets.lag:
            drive = drive.with_lag(belief.onsets.lag / memory.belief.onsets.lag)
        return replace(memory, belief=belief, drive=drive, attempt=None)
    belief, landing = memory.belief, attempt.landing
    trust = 1.0
    if landing is not None:
        belief = _with_landing(valve, belief, move, landing, rest)
        spread_m2 = landing.covariance.xx + rest.xx
        trust = _CERTAIN_M * _CERTAIN_M / (_CERTAIN_M * _CERTAIN_M + spread_m2)
    most_m = _MOST_OF_JUMP * valve.gap_n / valve.spring_n_per_m
    error_m = min(max(s * (rest.x - move.target_m), -most_m), most_m)
    change_m = valve.settings.bias_gain * trust * error_m
    biases = belief.biases.changed(s, change_m, most_m, near=move.near)
    return replace(memory, belief=replace(belief, biases=biases), attempt=None)


def _with_landing(valve: LaggedValve, belief: Belief, move: Move, landing: SlipState, rest: LaggedRest) -> Belief:
    """Return K and F_c after a slip: what its readings showed, and then where it ended."""
    p, doubt_m = landing.covariance, _MODEL * valve.gap_n / valve.spring_n_per_m
    by = p.xf / (p.xx + rest.xx + doubt_m * doubt_m)
    found_n = landing.sliding_n + by * (rest.x - landing.x)
    onsets, scatter2 = after_slip(
        belief.onsets, belief.scatter2, move.middle_m, move.direction, found_n, p.ff - by * p.xf
    )
    return replace(belief, onsets=valve.within(onsets), scatter2=scatter2)


def _undone(valve: LaggedValve, belief: Belief, attempt: Attempt) -> Belief:
    """Return the belief without the onset of a move that did not happen: F_s is above the force that was reached."""
    move, before = attempt.move, attempt.before
    x, s = move.origin_m, move.direction
    believed_n = s * (before.spring_n_per_m * x - attempt.spring_n_per_m * x) + before.static_n
    seen_n = attempt.spring_n_per_m * x + s * max(1.04 * attempt.peak_n, 1.01 * believed_n)
    loose = before.loosened(0.01 * valve.spring_n_per_m, 0.03 * valve.static_n, 0.0)
    doubt_n = 0.02 * before.static_n
    onsets = loose.with_onset(x, s, 0.0, seen_n, doubt_n * doubt_n)
    return replace(belief, onsets=valve.within(onsets), doubt=min(1.3 * belief.doubt, 0.15), seen=0)
