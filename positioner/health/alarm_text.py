"""Alarms in words: for the log, for `positioner health`, and for a report. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from positioner.health.causes import TEXTS
from positioner.health.reference import CONFIGURED
from positioner.health.watch import changes_of
from positioner.wire.words import in_words

if TYPE_CHECKING:
    from positioner.health.alarms import Alarm, Changed
    from positioner.health.watch import Trends, WatchSettings

_HOUR_S = 3600.0


def change_in_words(change: Changed) -> str:
    """Return the line of the log of an alarm that came, went or changed its level."""
    alarm = change.alarm
    if not alarm.is_active:
        return f"alarm over: {TEXTS[alarm.cause].what}: {_value(alarm)}"
    text = TEXTS[alarm.cause]
    begin = "alarm" if change.came else "alarm less serious"
    return f"{begin}: {text.what}: {_value(alarm)}, limit {_limit(alarm)} ({_category(alarm)}); {text.remedy}"


def alarm_lines(alarm: Alarm) -> tuple[str, ...]:
    """Return an alarm with category, value against limit, since when, evidence, how sure, and what to do."""
    text = TEXTS[alarm.cause]
    seen = "acknowledged" if alarm.acknowledged else "not acknowledged"
    state = _category(alarm) if alarm.is_active else "over"
    since = alarm.since or f"{alarm.since_s / _HOUR_S:.2f} h of operation"
    sure = f"{100.0 * alarm.sure:.0f} % sure" if alarm.is_active and alarm.sigma > 0.0 else ""
    evidence = ", ".join(each for each in (alarm.evidence, sure) if each)
    lines = [f"{state}: {text.what}: {_value(alarm)}, limit {_limit(alarm)}, since {since}, {seen}"]
    lines += [f"evidence: {evidence}"] if evidence else []
    return (*lines, f"remedy: {text.remedy}")


def alarm_as_json(alarm: Alarm) -> dict[str, Any]:
    """Return an alarm for a program; value and limit are parts, 0.2 is 20 %."""
    return {
        "cause": alarm.cause.key,
        "what": TEXTS[alarm.cause].what,
        "active": alarm.is_active,
        "category": alarm.category.name.lower(),
        "value": alarm.value,
        "limit": alarm.limit,
        "since": alarm.since,
        "since_s": alarm.since_s,
        "evidence": alarm.evidence,
        "sure": alarm.sure,
        "acknowledged": alarm.acknowledged,
        "remedy": TEXTS[alarm.cause].remedy,
    }


def trend_line(settings: WatchSettings, trends: Trends) -> str:
    """Return against what friction and spring are compared, and from how many moves."""
    reference = settings.reference
    if reference.source == CONFIGURED:
        head = "against the configuration, so that it raises no alarm: measure the valve with `positioner identify`"
    else:
        head = f"against `{reference.source}` of {reference.recorded}"
    return f"{head}; {trends.friction.moves} moves, {trends.friction.moves_up} of them opening"


def trends_as_json(settings: WatchSettings, trends: Trends) -> dict[str, Any]:
    """Return the trends for a program; changes are parts of the reference (0.2 is +20 %), None if unseen."""
    reference, found, moves = settings.reference, changes_of(settings, trends), trends.friction.moves
    shares = {
        "sliding_friction": found.friction,
        "static_friction": found.static,
        "spring_rate": found.spring,
        "spring_force": found.offset,
        "slip_jump": found.jump,
    }
    return {
        "reference": {"source": reference.source, "recorded": reference.recorded},
        "moves": moves,
        "moves_opening": trends.friction.moves_up,
        "one_sided": found.one_sided,
        "changes": {
            name: None if each is None or not moves else {"value": each.value, "low": each.low, "high": each.high}
            for name, each in shares.items()
        },
        "ends": {
            "closed": {"value": trends.closed if trends.closings else None, "seen": trends.closings},
            "open": {"value": trends.open if trends.openings else None, "seen": trends.openings},
        },
    }


def _value(alarm: Alarm) -> str:
    text = TEXTS[alarm.cause]
    return f"{text.factor * alarm.value:.3g} {text.unit}".rstrip()


def _limit(alarm: Alarm) -> str:
    return f"{TEXTS[alarm.cause].factor * alarm.limit:.3g}"


def _category(alarm: Alarm) -> str:
    return in_words(alarm.category)
