"""Which moves lead to a setpoint, and the currents of one move. Pure.

A stem can be stopped at a place r without measuring anything on the way: held at the pressure that balances spring and
sliding friction at r, it slides until it is there (the first of the two moves of Srinivasan and Rengaswamy 2008). Where
that pressure would not free it, because r is nearer than the slip jump, the stem is first moved away, to either side.

A light stem behind a slow pressure does not slide there at once: it jumps, sticks and jumps again, and its last jump
ends anywhere. From far enough on it slides through (`Stem.slides_through`), so its moves begin farther away.
"""

from __future__ import annotations

import math
from enum import Enum
from typing import TYPE_CHECKING, Final

from positioner.laws.correction import LEFT, pays
from positioner.values import dataclass

if TYPE_CHECKING:
    from collections.abc import Mapping

    from positioner.laws.nmpc.belief import ValveBelief

_FAR = 0.05
"""A setpoint that is farther away than a stem slides through by this part of the slip jump is reached by one move."""
_AWAY, _BACK = 0.15, 0.1
"""Slip jumps beyond that way from which the last move begins, and which the first one needs itself."""
_MORE_M = 0.0005
"""What readings may be wrong by, beside what is believed."""
_MARGIN = 0.15
"""Of the slip jump: so much nearer than planned the last move may begin."""
_BEYOND = 10.0
"""m of detour that a mA beyond the limits counts as: another way is better, if there is one."""
_BEYOND_TRAVEL = 100.0
"""Detours per m beyond the travel: a stem at its stop shows no balance."""
_MISSED, _MOST_MISSED = 0.01, 3.0
"""Of the travel: a last move whose landing has this σ misses, and costs a way there and back; one that is less sure
costs up to three of them. On all valves of the robustness test 1 and 3 lose 313 and 306 dwells, and without this 350
are lost instead of 340 (DESIGN.md, "The law `quasi-static`")."""
_EDGE, _AT_STOP = 0.002, 0.004
"""Of the travel: nearer to a stop no move ends on purpose, and nearer the stop may be what holds a stem."""
_TOLERANCE, _LOOSER = 0.0015, 0.25
"""Of the span: an error that is left; each move to the same setpoint makes it looser by a quarter."""
LARGE, _WORTH_LARGE, _WORTH_SMALL = 0.005, 1.2, 2.0
"""An error above 0.5 % of span is corrected where it exceeds 1.2 σ of the scatter of landings (then a move makes it
smaller in three of four cases, and teaches what is not known of the valve), a smaller one where it exceeds 2 σ of the
landing of the correction (then it is halved on average). σ of stops that are braked by reading is measured on such
stops alone, so 1.2 of it are enough for any error."""
_LONGEST_WAIT_S, _SOON = 60.0, 8
"""More pushes of a stem that is jammed only wear the actuator; one in a minute finds it free again. Before that it is
tried eight times after a second or two, so that twenty pushes in vain are soon made, of which the guard tells."""
_ALL = 0.999
"""Of the way to a limit: e⁻⁷, so at most seven lags are hurried through."""
_QUICK, _DAMPED = 4.0, 0.99
"""Of √(m/K): a pressure that arrives sooner is over before the stem has swung once. From this damping ratio on no swing
is left, e^(-π ζ/ρ) < 10⁻⁹."""
_MOST_JUMPS = 4.0
"""A way of more slip jumps than that leaves no room in the travel. No valve of the robustness test needs more."""


class Stage(Enum):
    """What a move is for."""

    AWAY = "away"
    """To where the next move can begin."""
    LAND = "land"
    """To the setpoint."""
    SLIP = "slip"
    """To the setpoint, and braked on the way."""
    RETURN = "return"
    """Of the pressure to the middle of the stick band; the stem stays."""


LEFT_OF_STEP: Final[Mapping[Stage | None, float]] = {Stage.AWAY: 0.1, Stage.LAND: 0.3}
"""Part of the way that is left for the level when a hurried pressure is released: a lag 20 % shorter than configured
then still stays short of it."""


@dataclass(frozen=True, slots=True)
class Step:
    """One move: its stage, the place in m where it ends, and its direction (±1)."""

    stage: Stage
    target_m: float
    direction: float


@dataclass(frozen=True, slots=True)
class Limits:
    """The currents in mA and the places in m between which moves are made."""

    low_ma: float
    high_ma: float
    low_m: float
    high_m: float

    @property
    def edge_m(self) -> float:
        """How near to the travel's ends no move ends."""
        return _EDGE * (self.high_m - self.low_m)

    def holds(self, position_m: float, direction: float) -> bool:
        """Return whether the stop may be what holds a stem that is pushed in a direction."""
        stop_m = self.high_m if direction > 0.0 else self.low_m
        return direction * (stop_m - position_m) < _AT_STOP * (self.high_m - self.low_m)

    def excess_ma(self, current_ma: float) -> float:
        """Return how far a current is beyond the limits, 0 within."""
        return max(self.low_ma - current_ma, current_ma - self.high_ma, 0.0)

    def clipped(self, current_ma: float) -> float:
        """Return the nearest current within the limits."""
        return min(max(current_ma, self.low_ma), self.high_ma)


def steps_to(
    belief: ValveBelief,
    limits: Limits,
    position_m: float,
    setpoint_m: float,
    through: float,
    from_m: tuple[float, float] = (0.0, 0.0),
) -> tuple[Step, ...]:
    """Return the moves of the shortest way to a setpoint that the currents allow, with what a miss would add to it.

    through: the slip jumps from which on a stem slides through. from_m: how far away the last move begins at
    least, upwards and downwards.
    """
    best: tuple[Step, ...] = ()
    steps: tuple[Step, ...]
    least = math.inf
    jump_m, doubt_m, missed_m = belief.jump_m, belief.jump_doubt_m, _MISSED * (limits.high_m - limits.low_m)
    for direction, least_m in zip((1.0, -1.0), from_m, strict=True):
        local_ma = belief.local_ma(setpoint_m, direction)
        weaker_m = _weaker_m(belief, local_ma, direction)
        begins_m = max((through + _AWAY) * jump_m + doubt_m + weaker_m + _MORE_M, least_m)
        land = Step(Stage.LAND, setpoint_m, direction)
        excess = _BEYOND * limits.excess_ma(belief.plain_ma(setpoint_m, direction) + local_ma)
        distance_m = direction * (setpoint_m - position_m)
        if distance_m > (through + _FAR) * jump_m + doubt_m + weaker_m:
            steps, way = (land,), distance_m + excess
        else:
            away_m = setpoint_m - direction * begins_m
            needed_m = (through + _BACK) * jump_m + doubt_m
            if direction * (position_m - away_m) < needed_m:
                away_m = position_m - direction * needed_m
            low_m, high_m = limits.low_m + limits.edge_m, limits.high_m - limits.edge_m
            beyond_m = max(low_m - away_m, away_m - high_m, 0.0)
            away_m = min(max(away_m, low_m), high_m)
            steps = (Step(Stage.AWAY, away_m, -direction), land)
            way = abs(away_m - position_m) + abs(setpoint_m - away_m) + excess
            way += _BEYOND_TRAVEL * beyond_m + _BEYOND * limits.excess_ma(belief.landing_ma(away_m, -direction))
        way += 2.0 * begins_m * min(_MOST_MISSED, belief.landing_sigma_m(setpoint_m, direction) / missed_m)
        if way < least:
            best, least = steps, way
    return best


def is_worth_it(
    belief: ValveBelief,
    steps: tuple[Step, ...],
    position_m: float,
    setpoint_m: float,
    span_m: float,
    lasts_s: float,
    tries: int,
    read_m: float = math.inf,
) -> bool:
    """Return whether a correction pays (`laws.correction`), and makes the error smaller, as far as is known.

    steps: its moves. lasts_s: how long a move lasts. tries: ways to this setpoint that were begun before. read_m: σ of
    a stop that is braked by reading, infinite where none is made.
    """
    first, *later = steps
    error_m = abs(setpoint_m - position_m)
    if later and error_m < LEFT * span_m and not pays(error_m, abs(first.target_m - setpoint_m), lasts_s, tries):
        return False
    if error_m > LARGE * span_m:
        least_m = _WORTH_LARGE * belief.scatter_m
    else:
        least_m = _WORTH_SMALL * belief.landing_sigma_m(setpoint_m, steps[-1].direction)
    return error_m > min(least_m, _WORTH_LARGE * read_m)


def tolerance_m(span_m: float, tries: int) -> float:
    """Return an error that is left after so many ways to a setpoint."""
    return _TOLERANCE * span_m * (1.0 + _LOOSER * tries)


def waits_s(number: int, *, moves: bool) -> float:
    """Return for how long a stem that was left rests before it is tried for the nth time, from 1; at last 60 s.

    moves: the last push has moved it. Pauses of less than 1.5 s would be taken for hunting (`cycle/hunting`).
    """
    return min(math.ldexp(2.0 if moves else 1.0, min(max(number - _SOON, 0), 6)), _LONGEST_WAIT_S)


def can_follow(belief: ValveBelief, position_m: float, step: Step, through: float) -> bool:
    """Return whether a move that begins at a place is long enough for the stem to stop at its target."""
    weaker_m = _weaker_m(belief, belief.local_ma(step.target_m, step.direction), step.direction)
    least_m = through * belief.jump_m + 0.5 * belief.jump_doubt_m + weaker_m
    return step.direction * (step.target_m - position_m) > least_m


def _weaker_m(belief: ValveBelief, local_ma: float, direction: float) -> float:
    """Return how much farther away a move must begin whose target has less friction than the valve: local_ma more."""
    return max(-direction * local_ma / belief.spring_ma_per_m, 0.0)


def margin_m(belief: ValveBelief) -> float:
    """Return how near to its place a move away must have come."""
    return _MARGIN * belief.jump_m + 0.5 * belief.jump_doubt_m + _MORE_M


def boost_samples(lag_s: float, period_s: float, whole_ma: float, step_ma: float, left: float) -> int:
    """Return for how many samples a current at its limit hurries the pressure on, before its level is commanded.

    Args:
        lag_s: of the pressure; lags in a row act as one lag of their sum, or slower.
        period_s: of a sample.
        whole_ma: from the pressure to the limit.
        step_ma: from the pressure to the level, on the same side.
        left: part of the step that is left for the level itself, which ends slowly, but is never passed.
    """
    if step_ma == 0.0 or lag_s <= 0.0:
        return 0
    done = min((1.0 - left) * step_ma / whole_ma, _ALL)
    return int(-lag_s * math.log(1.0 - done) / period_s)


@dataclass(frozen=True, slots=True)
class Stem:
    """What of a stem's motion does not follow from its balance: mass m/B and viscous friction F_v/B, per mA.

    mass in mA s²/m, viscous in mA s/m.
    """

    mass: float
    viscous: float

    def swings(self, spring_ma_per_m: float, lag_s: float) -> bool:
        """Return whether mass carries the stem noticeably beyond its balance.

        It does at a damping ratio below 1.2, where the pressure arrives in less than four of √(m/K).
        """
        is_free = self.viscous * self.viscous < 6.0 * self.mass * spring_ma_per_m
        return is_free and self._is_quick(spring_ma_per_m, lag_s)

    def shows_after_s(self, spring_ma_per_m: float) -> float:
        """Return after what time a stem that no lag holds back has gone through its slip jump: a quarter of a swing."""
        return 0.5 * math.pi * math.sqrt(self.mass / spring_ma_per_m)

    def slides_through(self, spring_ma_per_m: float, lag_s: float) -> float:
        """Return from how many slip jumps on a move behind a slow pressure ends in its first slip, at least 1.

        A stem that is freed swings around its balance, which goes on at the speed (D - J)/τ e^(-t/τ), D the length of
        the move, J the slip jump. With ω = √(K/m), the damping ratio ζ and ρ = √(1 - ζ²) it is slowest against it at
        ρ ω t = π + acos ζ = φ, by J ω e^(-φ ζ/ρ). It does not stop there if

            D/J > 1 + ω τ e^(-φ (ζ - 1/(ω τ))/ρ)
        """
        if self._is_quick(spring_ma_per_m, lag_s):
            return 1.0
        ratio = 0.5 * self.viscous / math.sqrt(self.mass * spring_ma_per_m)
        if ratio >= _DAMPED:
            return 1.0
        lags, phase = lag_s * math.sqrt(spring_ma_per_m / self.mass), math.pi + math.acos(ratio)
        jumps = 1.0 + lags * math.exp(-phase * (ratio - 1.0 / lags) / math.sqrt(1.0 - ratio * ratio))
        return min(jumps, _MOST_JUMPS)

    def _is_quick(self, spring_ma_per_m: float, lag_s: float) -> bool:
        """Whether the pressure arrives in less than four of √(m/K), so that the first slip ends after it."""
        return lag_s < _QUICK * math.sqrt(self.mass / spring_ma_per_m)
