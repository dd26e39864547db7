"""Whether the stem swings to and fro under commands, without an end, while its setpoint stands: it hunts. Pure.

A law whose belief of the valve is wrong, or that repeats itself, may move the stem past its setpoint again and again:
with much less friction than configured, with a lag that nobody has told it, or in the limit cycle of a sticking valve
under an integrator. Its error never stays, so it is no deviation. What tells hunting is law for law the same: the stem
reverses again and again, and reaches farther than a stem that keeps within 1 % of its setpoint.

A swing counts where the readings' mean goes back by more than `SWING_OF_SPAN`, and the command has changed meanwhile by
half of what the spring alone asks for over such a way: what no command moves is noise, or the process. The mean is
short, since the swings of a stem with little friction last for some samples only. Of white noise it leaves 0.38 σ, so
with σ = 2 % of the reading, 1.6 % of span at 80 % of it, a reversal of noise is one of 5 σ, again and again in turn.

A stem without friction may turn every two or three samples under a law that answers each reading, and such a mean shows
a fifth of that way. So there are two means: a quick one, which leaves 0.5 σ of white noise, sees the quickest swings
from `QUICK_OF_SPAN` of its own way on, which is 7 σ.

An ordinary correction moves the stem to and fro, too, for a second or two. So hunting lasts for `LASTS_S` without a
pause of more than `PAUSE_S`, with no less than `FEWEST` reversals; it is over after such a pause. A setpoint stands
within a quarter of a swing; while it moves, nothing counts.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.values import dataclass

if TYPE_CHECKING:
    from positioner.valve.parameters import ValveParameters

SWING_OF_SPAN = 0.03
"""A swing is larger; a stem within ±1 % of its setpoint, by a mean of 0.38 σ of noise, does not reach it."""
LASTS_S = 4.5
"""With the half period at whose end it is seen, of up to 0.5 s, this is 5 s."""
PAUSE_S = 1.5
"""The longest half of a period; a stem that does not turn for longer has come to rest."""
FEWEST = 10
"""Reversals, five whole swings: corrections on a valve whose friction changes from move to move turn up to nine times.
Where half a period is longer than 0.5 s they take longer than 5 s."""
FILTER_S, FILTER_PERIODS = 0.02, 3.0
"""The time constant of the mean is the longer of the two; noise that lasts for 10 ms is halved by the first."""
QUICK_OF_SPAN = 0.055
QUICK_S, QUICK_PERIODS = 0.0075, 1.5
"""The time constant of the quick mean, in the same way."""
_STANDS_OF_SWING = 0.25
_DRIVEN = 0.5


@dataclass(frozen=True, slots=True)
class Swings:
    """The turns of the stem since it last rested.

    setpoint_m: where the setpoint stood then; turned_m: the last turn. direction: from there, +1, -1, or 0 at rest.
    low_ma, high_ma: the commands between the two turns before. count: driven reversals; sum_m: of their ways.
    told: whether it hunts.
    """

    setpoint_m: float
    turned_m: float
    direction: int = 0
    low_ma: float = 0.0
    high_ma: float = 0.0
    count: int = 0
    sum_m: float = 0.0
    told: bool = False

    @property
    def mean_m(self) -> float:
        """How far the stem swings from turn to turn, 0 before the first."""
        return self.sum_m / self.count if self.count else 0.0


@dataclass(frozen=True, slots=True)
class Mean:
    """What one mean of the readings shows of the swings.

    position_m: the mean reading. farthest_m: the farthest mean since the last turn. swung_s: since they began; quiet_s:
    since the last turn. low_ma, high_ma: the commands since then.
    """

    position_m: float
    swings: Swings
    farthest_m: float
    swung_s: float
    quiet_s: float
    low_ma: float
    high_ma: float


@dataclass(frozen=True, slots=True)
class Hunting:
    """What is known of the swings, by the mean and by the quick mean."""

    mean: Mean
    quick: Mean

    @property
    def shown(self) -> Mean:
        """The mean that tells; where both do, the one that has counted more, and else the slower one."""
        if not self.quick.swings.told:
            return self.mean
        return self.quick if self.quick.swings.count > self.mean.swings.count else self.mean

    @property
    def swings(self) -> Swings:
        """The swings of the mean that tells."""
        return self.shown.swings

    @property
    def swung_s(self) -> float:
        """For how long they have lasted."""
        return self.shown.swung_s


@dataclass(frozen=True, slots=True)
class Hunts:
    """The stem swings: so many reversals in so many seconds, `swing_m` from turn to turn."""

    count: int
    swung_s: float
    swing_m: float
    setpoint_m: float

    def __str__(self) -> str:
        """One line for the log."""
        return (
            f"the stem hunts: {self.count} reversals in {self.swung_s:.1f} s, {self.swing_m * 1e3:.1f} mm each, around "
            f"its setpoint of {self.setpoint_m * 1e3:.1f} mm: look for less friction than configured and for a lag "
            "that is not; measure the valve: positioner identify"
        )


def track_hunting(
    valve: ValveParameters,
    known: Hunting | None,
    measured_m: float,
    setpoint_m: float,
    elapsed_s: float,
    period_s: float,
    sent_ma: float | None,
) -> Hunting | None:
    """Return the swings after the reading `measured_m`, which came `elapsed_s` after the last, None before the first.

    `sent_ma` is the command that was in force meanwhile, None where there was none. Readings come every `period_s`.
    """
    if sent_ma is None:
        return None
    if known is None:
        mean = Mean(measured_m, Swings(setpoint_m, measured_m), measured_m, 0.0, 0.0, sent_ma, sent_ma)
        return Hunting(mean, mean)
    weight = elapsed_s / (max(FILTER_S, FILTER_PERIODS * period_s) + elapsed_s)
    mean_m = known.mean.position_m + weight * (measured_m - known.mean.position_m)
    weight = elapsed_s / (max(QUICK_S, QUICK_PERIODS * period_s) + elapsed_s)
    quick_m = known.quick.position_m + weight * (measured_m - known.quick.position_m)
    return Hunting(
        _tracked(valve, known.mean, mean_m, SWING_OF_SPAN, setpoint_m, elapsed_s, sent_ma),
        _tracked(valve, known.quick, quick_m, QUICK_OF_SPAN, setpoint_m, elapsed_s, sent_ma),
    )


def _tracked(
    valve: ValveParameters,
    known: Mean,
    mean_m: float,
    least_of_span: float,
    setpoint_m: float,
    elapsed_s: float,
    sent_ma: float,
) -> Mean:
    """Return the swings with the mean `mean_m`; a swing is larger than `least_of_span`."""
    least_m, swings, quiet_s = least_of_span * valve.span_m, known.swings, known.quiet_s + elapsed_s
    moved = abs(setpoint_m - swings.setpoint_m) > _STANDS_OF_SWING * SWING_OF_SPAN * valve.span_m
    if moved or quiet_s > PAUSE_S:
        told = swings.told and quiet_s <= PAUSE_S  # a setpoint that moves ends no hunting
        after = Swings(setpoint_m, mean_m, told=told, sum_m=swings.mean_m if told else 0.0, count=1 if told else 0)
        return Mean(mean_m, after, mean_m, 0.0, quiet_s if told else 0.0, sent_ma, sent_ma)
    low_ma = min(known.low_ma, sent_ma)
    high_ma = max(known.high_ma, sent_ma)
    swung_s, farthest_m = known.swung_s + elapsed_s, known.farthest_m
    if swings.direction == 0:
        away_m = mean_m - swings.turned_m
        if abs(away_m) > least_m:
            return _begun(known, mean_m, away_m, low_ma, high_ma)
    else:
        farthest_m = max(farthest_m, mean_m) if swings.direction == 1 else min(farthest_m, mean_m)
        if abs(mean_m - farthest_m) > least_m:
            known = Mean(mean_m, swings, farthest_m, swung_s, quiet_s, low_ma, high_ma)
            return _turned(valve, known, sent_ma)
    return Mean(mean_m, swings, farthest_m, swung_s, quiet_s, low_ma, high_ma)


def _begun(known: Mean, mean_m: float, away_m: float, low_ma: float, high_ma: float) -> Mean:
    """Return the swings with a stem that has left its place by `away_m`."""
    swings = known.swings
    after = Swings(
        swings.setpoint_m,
        swings.turned_m,
        int(math.copysign(1.0, away_m)),
        low_ma,
        high_ma,
        swings.count,
        swings.sum_m,
        swings.told,
    )
    quiet_s = known.quiet_s if swings.told else 0.0
    return Mean(mean_m, after, mean_m, 0.0, quiet_s, low_ma, high_ma)


def _turned(valve: ValveParameters, known: Mean, sent_ma: float) -> Mean:
    """Return the swings with a stem that has turned at the farthest place."""
    swings = known.swings
    least_ma = _DRIVEN * SWING_OF_SPAN * valve.span_m * valve.spring_rate_n_per_m / valve.force_gain_n_per_ma
    low_ma, high_ma = min(known.low_ma, swings.low_ma), max(known.high_ma, swings.high_ma)
    driven = high_ma - low_ma >= least_ma
    count = swings.count + driven
    after = Swings(
        swings.setpoint_m,
        known.farthest_m,
        -swings.direction,
        known.low_ma,
        known.high_ma,
        count,
        swings.sum_m + (abs(known.farthest_m - swings.turned_m) if driven else 0.0),
        swings.told or (count >= FEWEST and known.swung_s >= LASTS_S),
    )
    quiet_s = 0.0 if driven else known.quiet_s
    return Mean(known.position_m, after, known.position_m, known.swung_s, quiet_s, sent_ma, sent_ma)
