"""Alarms, and how friction and spring have changed since the reference, as sections and verdicts. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import datetime
from typing import TYPE_CHECKING, Any

from positioner.health.causes import TEXTS, AlarmCause
from positioner.health.friction_watched import friction_watched
from positioner.health.reference import CONFIGURED
from positioner.health.watch import changes_of
from positioner.report import words
from positioner.report.chart import Chart
from positioner.report.layers import Limit, Line, Marks, Whiskers
from positioner.report.page import Section, Status, Verdict
from positioner.report.table import Table
from positioner.report.trend_table import trend_table
from positioner.wire.messages import Health

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from positioner.commissioning.results import KeptResult
    from positioner.health.alarms import Alarm
    from positioner.health.causes import Limits
    from positioner.health.counters import Counters
    from positioner.health.friction_trend import Changes, Share
    from positioner.health.watch import Trends, WatchSettings
    from positioner.report.layers import Layer

_PERCENT, _Z = 100.0, 1.96
_AGES = (("years", 365.25 * 86_400.0), ("days", 86_400.0), ("hours", 3600.0), ("minutes", 60.0), ("seconds", 1.0))
"""Units of an age, in s; it is told in the first one of which it has two or more."""
_FEWEST = 2.0
_FRICTION = "sliding friction"


@dataclass(frozen=True, slots=True)
class Service:
    """What was counted and watched in service, since and until when, empty where that is not known."""

    counters: Counters
    trends: Trends
    watch: WatchSettings
    started: str
    until: datetime | None


def verdict_of_alarm(alarm: Alarm) -> Verdict:
    """Return what an active alarm says of the valve."""
    text = TEXTS[alarm.cause]
    since = f" since {_date(alarm.since)}" if alarm.since else ""
    sentence = f"{text.what}{since}: {alarm.evidence}."
    if text.unit:
        sentence = f"{text.what}{since}: {_value(alarm)}, the limit is {_limit(alarm)}; {alarm.evidence}."
    return Verdict(Status[alarm.category.name], _sentence(sentence), _sentence(f"{text.remedy}."))


def alarm_section(alarms: Sequence[Alarm]) -> Section:
    """Return the alarms that are active, or that nobody has acknowledged yet."""
    head = ("alarm", "status", "value", "limit", "since", "how sure", "seen")
    shown = sorted((each for each in alarms if each.is_active or not each.acknowledged), key=lambda each: -each.level)
    rows = tuple([_alarm_row(each) for each in shown])
    if not rows:
        return Section("Alarms", remarks=("No alarm is active, and none waits to be acknowledged.",))
    if len(shown) == 1:  # the verdict tells what to do
        return Section("Alarms", tables=(Table(head, rows),))
    remarks = tuple([_sentence(f"{TEXTS[each.cause].what}: {TEXTS[each.cause].remedy}.") for each in shown])
    return Section("Alarms", tables=(Table(head, rows),), remarks=remarks)


def _alarm_row(alarm: Alarm) -> tuple[str, ...]:
    status = Status[alarm.category.name].words if alarm.is_active else "has ended"
    sure = f"{_PERCENT * alarm.sure:.0f} %" if alarm.is_active else words.NONE
    seen = "yes" if alarm.acknowledged else "no"
    return (TEXTS[alarm.cause].what, status, _value(alarm), _limit(alarm), _date(alarm.since), sure, seen)


def _value(alarm: Alarm) -> str:
    return _in_words(alarm.cause, alarm.value)


def _limit(alarm: Alarm) -> str:
    return _in_words(alarm.cause, alarm.limit)


def _in_words(cause: AlarmCause, value: float) -> str:
    text = TEXTS[cause]
    number = words.number(value * text.factor, 1 if abs(text.factor) > 1.0 else 2)
    return f"{number}\N{NO-BREAK SPACE}{text.unit}".rstrip()


def trend_section(service: Service, signatures: Sequence[KeptResult]) -> Section:
    """Return what has changed since the reference; `signatures` are the kept ones, oldest first."""
    settings, trends, reference = service.watch, service.trends, service.watch.reference
    title = "Friction trend"
    if reference.source == CONFIGURED:
        return Section(
            title, missing="There is no reference yet: positioner signature or positioner identify gives one."
        )
    if not trends.friction.moves:
        return Section(title, missing="No move in service has shown the friction yet: it takes full slips of the stem.")
    found = changes_of(settings, trends)
    moves = f"from {trends.friction.moves} moves, {trends.friction.moves_up} of them opening"
    remarks = [f"In service: {moves}; λ = {settings.averaging:g}."]
    if _is_told(AlarmCause.ONE_SIDED, found, service):
        remarks.insert(0, "One direction alone has changed: this is no friction, but air supply or converter.")
    since = f"against the {reference.source} of {_date(reference.recorded)}"
    newest = (service.until, found.friction) if service.until else None
    chart = friction_chart(signatures, reference.sliding_n, newest, settings.limits)
    return Section(title, since, (chart,) if chart else (), (trend_table(found, settings.limits),), tuple(remarks))


def _is_told(cause: AlarmCause, found: Changes, service: Service) -> bool:
    """Return whether a change is as large as its alarm asks for: of less, the noise of a few moves is the reason."""
    limit = service.watch.limits[cause].limit
    values = (each.value for each in friction_watched(found, service.trends.friction) if each.cause is cause)
    return limit > 0.0 and any(value >= limit for value in values)


def friction_chart(
    signatures: Sequence[KeptResult],
    reference_n: float,
    service: tuple[datetime, Share] | None,
    limits: Mapping[AlarmCause, Limits],
) -> Chart | None:
    """Return the sliding friction of each signature, and that in service, against the reference, by their age."""
    points = [point for point in map(_point, signatures) if point is not None]
    if not points or len(points) + (service is not None) < 2:  # noqa: PLR2004 - one point is no trend
        return None
    first = points[0][0]
    ages_s = [(moment - first).total_seconds() for moment, _, _ in points]
    served_s = max((service[0] - first).total_seconds(), 0.0) if service else 0.0
    oldest_s = max(*ages_s, served_s)
    unit, unit_s = next((each for each in _AGES if oldest_s >= _FEWEST * each[1]), _AGES[-1])
    ages = [age_s / unit_s for age_s in ages_s]
    values = [_PERCENT * (value / reference_n - 1.0) for _, value, _ in points]
    halves = [_PERCENT * half / reference_n for _, _, half in points]
    low = [value - half for value, half in zip(values, halves, strict=True)]
    high = [value + half for value, half in zip(values, halves, strict=True)]
    own = limits[AlarmCause.FRICTION_HIGH], limits[AlarmCause.FRICTION_LOW]
    layers = [
        Limit(sign * _PERCENT * level, Status[category.name].words, Status[category.name].style)
        for sign, each in zip((1.0, -1.0), own, strict=True)
        for level, category in ((each.limit, each.category), (each.serious_limit, each.serious_category))
        if level > 0.0 and category is not Health.GOOD
    ]
    drawn: list[Layer] = [*layers, Line(ages, values), Whiskers(ages, low, high), Marks(ages, values, "signatures")]
    if service is not None:
        share, at = service[1], [served_s / unit_s]
        ends = [_PERCENT * share.low], [_PERCENT * share.high]
        drawn += [Whiskers(at, *ends), Marks(at, [_PERCENT * share.value], "in service", "down")]
    title = "Sliding friction against the reference"
    return Chart(title, f"{unit} since the first signature", "%", tuple(drawn), size="wide")


def _point(signature: KeptResult) -> tuple[datetime, float, float] | None:
    """Return date, sliding friction and half its interval in N (NaN without one); None for a damaged result."""
    try:
        return signature.recorded, float(signature.document["quantities"]["sliding_n"]), _half(signature.document)
    except (KeyError, TypeError, ValueError):
        return None


def _half(document: dict[str, Any]) -> float:
    row = next((each for each in document["rows"] if each["name"] == _FRICTION), None)
    if row is None or row["low"] is None or row["high"] is None:
        return math.nan
    return float(row["high"] - row["low"]) / 2.0


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:].replace("`", "")


def _date(text: str) -> str:
    """Return an ISO date as it is read elsewhere on the page, or the text as it is."""
    try:
        return words.date(datetime.fromisoformat(text))
    except ValueError:
        return text or words.NONE
