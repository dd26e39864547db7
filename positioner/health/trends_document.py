"""Trends and alarms as plain values, for the saved document and for programs. Pure."""

from __future__ import annotations

import math
from dataclasses import fields
from typing import TYPE_CHECKING, Any

from positioner.health.alarms import Alarm
from positioner.health.causes import AlarmCause
from positioner.health.friction_trend import FrictionTrend, is_possible
from positioner.health.plain_values import plain, value_like
from positioner.health.watch import Trends
from positioner.values import replace
from positioner.wire.messages import Health

if TYPE_CHECKING:
    from positioner.health.reference import Reference

TRENDS = "trends"
"""The name of the section."""
_FRICTION = tuple(each.name for each in fields(FrictionTrend))
_ENDS = ("closed", "closings", "open", "openings")
_ALARM = tuple(each.name for each in fields(Alarm))
_DAY = len("2026-01-01")
"""Of a reference, earlier versions kept the day alone."""


def trends_in(trends: Trends) -> dict[str, Any]:
    """Return the section of these trends."""
    friction = {name: plain(getattr(trends.friction, name)) for name in _FRICTION}
    return {
        "against": list(trends.against),
        "friction": friction,
        "ends": [getattr(trends, name) for name in _ENDS],
        "alarms": [_alarm_in(alarm) for alarm in trends.alarms],
    }


def trends_from(section: Any, reference: Reference | None) -> Trends:
    """Return the trends in their section, None for one that was never written; without a reference to check it only.

    Friction and ends begin anew where they were against another reference; the alarms stay until the new trends say
    otherwise.

    Raises:
        ValueError: it is not as it was written.
    """
    against = (reference.source, reference.recorded) if reference is not None else ("", "")
    if section is None:
        return Trends(against)
    if not isinstance(section, dict) or set(section) != {"against", "friction", "ends", "alarms"}:
        raise ValueError("the trends are not as this version writes them")
    alarms = section["alarms"]
    if not isinstance(alarms, list) or len(alarms) > len(AlarmCause):
        raise ValueError("the alarms are no list of causes")
    found = Trends(against, alarms=tuple([_alarm_from(each) for each in alarms]))
    friction, ends = section["friction"], section["ends"]
    if not isinstance(friction, dict) or set(friction) != set(_FRICTION):
        raise ValueError("the friction's trend is not as this version writes it")
    none = FrictionTrend()
    trend = replace(none, **{name: value_like(name, getattr(none, name), friction[name]) for name in _FRICTION})
    if not is_possible(trend):
        raise ValueError("the friction's trend is none that moves lead to")
    match ends:
        case [float(closed), int(closings), float(opened), int(openings)] if closings >= 0 and openings >= 0:
            if section["against"] not in ([*against], [against[0], against[1][:_DAY]]):
                return found
            return replace(found, friction=trend, closed=closed, closings=closings, open=opened, openings=openings)
    raise ValueError("the end positions are not as this version writes them")


def _alarm_in(alarm: Alarm) -> dict[str, Any]:
    values = {name: getattr(alarm, name) for name in _ALARM}
    beyond_s = None if math.isnan(alarm.beyond_s) else alarm.beyond_s
    return {**values, "cause": alarm.cause.key, "category": alarm.category.name.lower(), "beyond_s": beyond_s}


def _alarm_from(given: Any) -> Alarm:
    if not isinstance(given, dict) or set(given) != set(_ALARM):
        raise ValueError("an alarm is not as this version writes it")
    try:
        cause, category = AlarmCause[str(given["cause"]).upper()], Health[str(given["category"]).upper()]
    except KeyError as error:
        raise ValueError(f"an alarm has the unknown cause or category {error}") from None
    beyond_s = math.nan if given["beyond_s"] is None else given["beyond_s"]
    numbers = (given["since_s"], given["value"], given["sigma"], given["limit"], beyond_s)
    if not all(type(each) is float for each in numbers) or given["level"] not in {0, 1, 2}:
        raise ValueError(f"the alarm {cause.key} has no numbers")
    since_s, value, sigma, limit, beyond_s = numbers
    texts, is_seen = (given["evidence"], given["since"]), given["acknowledged"]
    if not all(isinstance(each, str) for each in texts) or not isinstance(is_seen, bool):
        raise ValueError(f"the alarm {cause.key} has no evidence")
    return Alarm(
        cause,
        int(given["level"]),
        category,
        since_s,
        value,
        sigma,
        limit,
        given["evidence"],
        beyond_s,
        is_seen,
        given["since"],
    )
