"""Alarms: one for each cause, with its NE 107 category, since when, value against limit, and how sure it is. Pure.

An alarm comes when its value has been beyond the limit for the delay, and the change is no chance. It ends when the
value is below `clears_at` of the limit. It is shown until a person has acknowledged it, also after it has ended.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.cycle.alarms import packed
from positioner.values import dataclass, replace
from positioner.wire.messages import Health

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from positioner.health.causes import AlarmCause, Limits

_NO_CHANCE = 3.0
"""Standard deviations that a value must differ from that of the reference."""


@dataclass(frozen=True, slots=True)
class Watched:
    """The value of a cause, its standard deviation, 0 where it is exact, and from what it follows."""

    cause: AlarmCause
    value: float
    sigma: float = 0.0
    evidence: str = ""


@dataclass(frozen=True, slots=True)
class Alarm:
    """One cause that is or was beyond its limit.

    level: 0 while it is not (yet, or no longer) an alarm, 1 beyond the limit, 2 beyond the serious one.
    since_s: the time of operation at which it came; limit: the one that it is beyond.
    beyond_s: since when the value is beyond the limit of a higher level, NaN while it is not.
    acknowledged: a person has seen it. since: the date at which it came, empty while the shell has not given one.
    """

    cause: AlarmCause
    level: int
    category: Health
    since_s: float
    value: float
    sigma: float
    limit: float
    evidence: str
    beyond_s: float = math.nan
    acknowledged: bool = False
    since: str = ""

    @property
    def is_active(self) -> bool:
        """Whether the value is beyond its limit now."""
        return self.level > 0

    @property
    def sure(self) -> float:
        """The probability that the true value is beyond the limit below which the alarm ends, about 80 % of its own."""
        if self.sigma <= 0.0:
            return 1.0
        return 0.5 * math.erfc((0.8 * self.limit - self.value) / (self.sigma * math.sqrt(2.0)))


@dataclass(frozen=True, slots=True)
class Changed:
    """An alarm came, went or changed its level: a line for the log."""

    alarm: Alarm
    came: bool


def judged(
    alarms: tuple[Alarm, ...], limits: Mapping[AlarmCause, Limits], watched: Iterable[Watched], now_s: float
) -> tuple[tuple[Alarm, ...], tuple[Changed, ...]]:
    """Return the alarms with the newest values, by cause, and those that came or went."""
    known = {alarm.cause: alarm for alarm in alarms}
    happened: list[Changed] = []
    for each in watched:
        before, limit = known.get(each.cause), limits[each.cause]
        after = _judged(before, limit, each, now_s)
        level_before = before.level if before is not None else 0
        level_after = after.level if after is not None else 0
        if after is not None and level_after != level_before:
            happened.append(Changed(after, level_after > level_before))
        if after is None:
            known.pop(each.cause, None)
        else:
            known[each.cause] = after
    return tuple([known[cause] for cause in sorted(known)]), tuple(happened)


def _judged(before: Alarm | None, limits: Limits, watched: Watched, now_s: float) -> Alarm | None:
    """Return the alarm of one cause; None where there is nothing to show or to remember."""
    value, level = watched.value, before.level if before is not None else 0
    wanted = _level(limits, watched)
    while level > wanted and value < limits.clears_at * _limit(limits, level):
        level -= 1
    beyond_s = before.beyond_s if before is not None else math.nan
    if wanted <= level:
        beyond_s = math.nan
    elif math.isnan(beyond_s):
        beyond_s = now_s
    if wanted > level and now_s - beyond_s >= limits.delay_s:
        level, beyond_s = wanted, math.nan
    if before is None:
        if level == 0 and math.isnan(beyond_s):
            return None
        before = Alarm(watched.cause, 0, Health.GOOD, now_s, value, watched.sigma, 0.0, "", acknowledged=True)
    if level == 0 and before.acknowledged and math.isnan(beyond_s):
        return None
    rises = level > before.level
    since_s = now_s if rises and before.level == 0 else before.since_s
    since = "" if rises and before.level == 0 else before.since
    acknowledged = before.acknowledged and not rises
    if level == 0:
        return replace(before, level=0, value=value, sigma=watched.sigma, beyond_s=beyond_s, acknowledged=acknowledged)
    category = limits.serious_category if level > 1 else limits.category
    limit = _limit(limits, level)
    return Alarm(
        watched.cause,
        level,
        category,
        since_s,
        value,
        watched.sigma,
        limit,
        watched.evidence,
        beyond_s,
        acknowledged,
        since,
    )


def _level(limits: Limits, watched: Watched) -> int:
    """Return the level of a value; a category of GOOD switches the alarm off."""
    if abs(watched.value) < _NO_CHANCE * watched.sigma:
        return 0
    is_serious = 0.0 < limits.serious_limit <= watched.value
    if is_serious and limits.serious_category is not Health.GOOD:
        return 2
    return 1 if watched.value >= limits.limit and limits.category is not Health.GOOD else 0


def _limit(limits: Limits, level: int) -> float:
    return limits.serious_limit if level > 1 else limits.limit


def acknowledged(alarms: tuple[Alarm, ...], causes: Iterable[AlarmCause]) -> tuple[Alarm, ...]:
    """Return the alarms after a person has acknowledged these causes; those that have ended are gone."""
    seen = set(causes)
    after = [replace(each, acknowledged=True) if each.cause in seen else each for each in alarms]
    return tuple([each for each in after if each.is_active or not each.acknowledged or not math.isnan(each.beyond_s)])


def dated(alarms: tuple[Alarm, ...], date: str) -> tuple[Alarm, ...]:
    """Return the alarms, those that have come and have no date yet with this one."""
    return tuple([replace(each, since=date) if each.is_active and not each.since else each for each in alarms])


def worst(alarms: Iterable[Alarm]) -> Health:
    """Return the worst category of the active alarms, GOOD without one."""
    return max((each.category for each in alarms if each.is_active), default=Health.GOOD)


def packed_alarms(alarms: tuple[Alarm, ...]) -> int:
    """Return the number that a cycle is given: worst category, active causes, and those nobody has acknowledged."""
    if not alarms:
        return 0
    active = bits([each.cause for each in alarms if each.is_active])
    unseen = bits([each.cause for each in alarms if not each.acknowledged])
    return packed(worst(alarms), active, unseen)


def bits(causes: Iterable[AlarmCause]) -> int:
    """Return the bits of causes, as POSITIONER_ALARMS carries them."""
    found = 0
    for cause in causes:
        found |= 1 << int(cause)
    return found
