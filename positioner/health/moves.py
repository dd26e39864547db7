"""Moves of the stem from rest to rest, seen in the stem position and the current that acted; their friction. Pure.

Between two rests the work of the pressure is that of spring and friction, whatever the path between them:
    ∫B·p dx = F_0·Δx + K·Δx·x̄ + F_c·|Δx| + F_v·∫v² dt,    x̄ = (x_before + x_after)/2.
So y = (∫B·p dx - F_v·∫v² dt)/Δx = F_0 + K·x̄ ± F_c. Where short rests divide
the way, |Δx| with F_c is the sum of all its parts. The current is constant between two readings, so its work is exact;
the noise of a reading counts only where the current changes. The Stribeck term works only at the ends; it is left out.

Readings show ∫v² dt too small where the speed changes much between two of them: in periods of 5 ms by a third of the
viscous work, which would then count as friction. How much is missing shows a stem that is played beside the true one,
by the configured valve in closed form: its ∫v² dt is known from the balance of its energy, and the same sum over what
readings of it would be is taken off.

The stem slips from rest at B·u = F_0 + K·x ± F_s, which shows F_s where the current rose slowly.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from positioner.health.move import Move
from positioner.values import dataclass

if TYPE_CHECKING:
    from positioner.health.move import MoveSettings

_STANDS_OUT: Final = 4.0
_CONFIRMS: Final = 3.0
"""Standard deviations by which a reading leaves a rest, and by which the next one confirms it."""
_AGREE = 5.0
"""Standard deviations of the spread of readings that agree."""
_TURNS = 8.0
"""Standard deviations by which a stem that turned back has come back: its path is longer than its way."""
_FEW: Final = 8
_ENOUGH: Final = 24
_HALF: Final = 12
"""Readings that agree before a stem counts as at rest, and those that a known place of rest needs."""
_REMEMBERED: Final = 256
"""Readings in the mean of a rest, at most."""
_CREEPS = 4.0
_LOST_S: Final = 1.5
"""Sample periods between two readings, beyond which a move between them shows nothing."""


@dataclass(slots=True)
class MoveTracker:
    """The rest or the move that is under way; `follow` changes it in place.

    rest: `count` readings with the mean rest_m; first_m: the mean of its first readings; low_ma, high_ma: the currents
    under which it lasted, but for the newest three; suspect_m: a reading that may begin a move, NaN without one.
    moving: work in mA·m, ∫v² dt in square, what the noise does to the work in swing; part_m: where the present part of
    the way began, path_m: the parts before it; side: of the first part.
    played_m, played_m_per_s, played_step_m: place, speed and newest step of the stem that is played beside.
    """

    count: int = 0
    rest_m: float = 0.0
    first_m: float = 0.0
    rest_s: float = 0.0
    low_ma: float = math.inf
    high_ma: float = -math.inf
    newest_ma: float = math.nan
    second_ma: float = math.nan
    third_ma: float = math.nan
    suspect_m: float = math.nan
    suspect_ma: float = 0.0
    moving: bool = False
    open: bool = False
    at_s: float = 0.0
    begun_s: float = 0.0
    begun_m: float = 0.0
    begun_count: int = 0
    slip_ma: float = 0.0
    held_ma: float = 0.0
    held_low_ma: float = 0.0
    held_high_ma: float = 0.0
    direction: float = 0.0
    whole: bool = True
    work: float = 0.0
    square: float = 0.0
    readings: int = 0
    swing: float = 0.0
    farthest_m: float = 0.0
    part_m: float = 0.0
    side: float = 0.0
    path_m: float = 0.0
    last_m: float = 0.0
    last_ma: float = 0.0
    before_m: float = 0.0
    recent: tuple[float, ...] = ()
    played_m: float = 0.0
    played_m_per_s: float = 0.0
    played_step_m: float = 0.0


def follow(
    settings: MoveSettings, state: MoveTracker, at_s: float, elapsed_s: float, x_m: float, ma: float
) -> Move | None:
    """Take in a reading at `at_s`, `elapsed_s` after the last one, and return a move that is over.

    `ma` is the current that acted between the two readings. The move is returned when the rest after it is known.
    """
    late = elapsed_s > _LOST_S * settings.period_s
    if state.moving:
        _slide(settings, state, elapsed_s, x_m, ma, late=late)
        return None
    state.rest_s += elapsed_s
    sigma = settings.sigma_m(state.rest_m)
    if not math.isnan(state.suspect_m):
        side = math.copysign(1.0, state.suspect_m - state.rest_m)
        if side * (x_m - state.rest_m) > _CONFIRMS * sigma:
            _begin(settings, state, at_s, elapsed_s, x_m, ma, side, late=late)
            return None
        _rest(state, state.suspect_m, state.suspect_ma)
        state.suspect_m = math.nan
    if state.count >= _FEW and abs(x_m - state.rest_m) > _STANDS_OUT * sigma * math.sqrt(1.0 + 1.0 / state.count):
        state.suspect_m, state.suspect_ma = x_m, ma
        return None
    _rest(state, x_m, ma)
    return _ended(settings, state) if state.open and state.count == _ENOUGH else None


def _rest(state: MoveTracker, x_m: float, ma: float) -> None:
    state.count = min(state.count + 1, _REMEMBERED)
    state.rest_m += (x_m - state.rest_m) / state.count
    if state.count == _HALF:
        state.first_m = state.rest_m
    third_ma = state.third_ma  # in the two after it the stem may have slid; NaN is below and above nothing
    if third_ma < state.low_ma:  # noqa: PLR1730 - NaN again
        state.low_ma = third_ma
    if third_ma > state.high_ma:  # noqa: PLR1730
        state.high_ma = third_ma
    state.third_ma, state.second_ma, state.newest_ma = state.second_ma, state.newest_ma, ma


def _begin(
    settings: MoveSettings,
    state: MoveTracker,
    at_s: float,
    elapsed_s: float,
    x_m: float,
    ma: float,
    side: float,
    *,
    late: bool,
) -> None:
    """Begin a move with the two readings that left the rest; the first of them slid under its own current alone."""
    first_m, first_ma = state.suspect_m, state.suspect_ma
    if state.open and state.count < _ENOUGH:  # a correction soon after a landing belongs to the same move
        _end_part(state)
    else:
        _begin_first(settings, state, at_s, first_ma, side)
    step_m = first_m - state.rest_m
    state.work += first_ma * step_m
    state.square += step_m * step_m / settings.period_s
    state.played_m, state.played_m_per_s, state.played_step_m = state.rest_m, 0.0, 0.0
    state.readings += 1
    state.moving, state.open, state.direction, state.whole = True, False, side, state.whole and not late
    _play(settings, state, settings.period_s, first_ma, first=True)
    state.part_m = state.before_m = state.rest_m
    state.last_m, state.last_ma, state.farthest_m = first_m, first_ma, first_m
    state.recent = (first_m,)
    state.suspect_m = math.nan
    _slide(settings, state, elapsed_s, x_m, ma, late=late)


def _begin_first(settings: MoveSettings, state: MoveTracker, at_s: float, first_ma: float, side: float) -> None:
    """Begin a move at a rest, and note under which currents it lasted and ended."""
    state.whole = state.count >= _ENOUGH and not _creeps(settings, state)
    state.begun_m, state.begun_count, state.begun_s, state.at_s = state.rest_m, state.count, state.rest_s, at_s
    state.side = side
    state.held_low_ma, state.held_high_ma = state.low_ma, state.high_ma
    state.held_ma = state.high_ma if side > 0.0 else state.low_ma
    state.slip_ma = side * max(
        [side * each for each in (first_ma, state.held_ma, state.newest_ma, state.second_ma, state.third_ma)]
    )
    state.work = state.square = state.swing = state.path_m = 0.0
    state.readings = 0


def _end_part(state: MoveTracker) -> None:
    """Add the work up to the place of rest, and the way to it."""
    state.work += state.last_ma * (state.rest_m - state.last_m)
    state.path_m += abs(state.rest_m - state.part_m)


def _slide(settings: MoveSettings, state: MoveTracker, elapsed_s: float, x_m: float, ma: float, *, late: bool) -> None:
    step_m, change = x_m - state.last_m, x_m - 2.0 * state.last_m + state.before_m
    state.work += ma * step_m
    state.square += (step_m * step_m + change * change / 12.0) / elapsed_s
    _play(settings, state, elapsed_s, ma)
    state.swing += (ma - state.last_ma) * (ma - state.last_ma)
    state.readings += 1
    state.farthest_m = state.direction * max(state.direction * state.farthest_m, state.direction * x_m)
    state.before_m, state.last_m, state.last_ma = state.last_m, x_m, ma
    state.whole = state.whole and not late
    state.recent = (*state.recent, x_m)[-_FEW:]
    sigma = settings.sigma_m(x_m)
    if state.direction * (state.farthest_m - x_m) > _TURNS * sigma:
        state.whole = False
    if len(state.recent) == _FEW and max(state.recent) - min(state.recent) <= _AGREE * sigma:
        state.moving, state.open = False, True
        state.count, state.rest_m, state.rest_s = 0, 0.0, _FEW * settings.period_s
        state.low_ma, state.high_ma = math.inf, -math.inf
        state.newest_ma = state.second_ma = state.third_ma = math.nan
        for each in state.recent:
            _rest(state, each, ma)


def _play(settings: MoveSettings, state: MoveTracker, elapsed_s: float, ma: float, *, first: bool = False) -> None:
    """Play the stem for a period, and add the part of its ∫v² dt that readings of it do not show."""
    model, load, x_m, v = settings.model, settings.load, state.played_m, state.played_m_per_s
    if load.viscous_n_s_per_m <= 0.0:
        return
    after = model.step(x_m, v, ma, load, state.direction, elapsed_s)
    step_m = after.x - x_m
    balance_n = model.push_n(ma, state.direction, load.friction_n) - load.spring_n_per_m * (x_m + 0.5 * step_m)
    work_j = balance_n * step_m - 0.5 * model.mass_kg * (after.v * after.v - v * v)
    change = 0.0 if first else step_m - state.played_step_m
    state.square += work_j / load.viscous_n_s_per_m - (step_m * step_m + change * change / 12.0) / elapsed_s
    state.played_m, state.played_m_per_s, state.played_step_m = after.x, after.v, step_m


def _creeps(settings: MoveSettings, state: MoveTracker) -> bool:
    """Return whether the second half of a rest lies elsewhere than the first."""
    scatter = settings.sigma_m(state.rest_m) * math.sqrt(1.0 / _HALF + 1.0 / state.count)
    return abs(state.rest_m - state.first_m) > _CREEPS * scatter


def _ended(settings: MoveSettings, state: MoveTracker) -> Move:
    state.open = False
    gain, sigma = settings.gain_n_per_ma, settings.sigma_m(state.rest_m)
    way_m = state.rest_m - state.begun_m
    _end_part(state)
    # noise makes each square larger: by 2 σ², and by 6 σ²/12 of the second difference
    square = state.square - 2.5 * sigma * sigma * state.readings / settings.period_s
    noise = state.swing * sigma * sigma + state.last_ma * state.last_ma * sigma * sigma * (
        1.0 / _ENOUGH + 1.0 / state.begun_count
    )
    whole = state.whole and abs(way_m) > _TURNS * sigma and not _creeps(settings, state)
    force_n = (gain * state.work - settings.load.viscous_n_s_per_m * max(square, 0.0)) / way_m if whole else math.nan
    return Move(
        at_s=state.at_s,
        rest_s=state.begun_s,
        before_m=state.begun_m,
        after_m=state.rest_m,
        direction=math.copysign(1.0, way_m),
        path_m=state.path_m,
        force_n=force_n,
        force_sigma_n=gain * math.sqrt(noise) / abs(way_m) if whole else math.inf,
        slip_n=0.5 * gain * (state.slip_ma + state.held_ma),
        slip_half_n=math.inf if state.side * way_m < 0.0 else 0.5 * gain * abs(state.slip_ma - state.held_ma),
        lowest_n=gain * state.held_low_ma,
        highest_n=gain * state.held_high_ma,
        complete=whole,
    )
