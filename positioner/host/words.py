"""The positioner's state in words. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.wire.messages import Cause, Health, Mode
from positioner.wire.words import in_words

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from positioner.guard.settings import GuardSettings
    from positioner.wire.messages import Counted, PositionerAlarms, PositionerStatus

CAUSES: Mapping[Cause, str] = {
    Cause.NONE: "controls the valve",
    Cause.WAITING_FOR_FEEDBACK: "waits for position frames",
    Cause.WAITING_FOR_ARM: "waits to be armed",
    Cause.FEEDBACK_STALE: "no position frames come",
    Cause.FEEDBACK_IMPLAUSIBLE: "position frames come, but their readings cannot be true",
    Cause.SETPOINT_STALE: "the host sends no setpoint any more",
    Cause.FOREIGN_COMMAND: "another controller commands this valve",
    Cause.LAW_FAILED: "the control law failed",
    Cause.DISARMED: "disarmed",
    Cause.FEEDBACK_FROZEN: "the position reading is frozen",
    Cause.LAW_LATE: "cycles take longer than the sample period",
    Cause.DEVIATION: "the position stays away from the setpoint",
    Cause.SETPOINT_UNREACHABLE: "the setpoint is out of the valve's reach",
    Cause.STALLED: "the positioner was stopped for a time",
    Cause.FEEDBACK_DISPUTED: "two senders of position frames contradict each other",
    Cause.SETPOINT_DISPUTED: "two hosts send setpoints",
    Cause.ACTUATOR_FAILED: "the actuator is in its fail position and obeys no command",
    Cause.COMMAND_IGNORED: "the valve does not follow its commands",
    Cause.MANUAL: "the current is given by hand",
    Cause.PERIOD_WRONG: "position frames come at another period than the configured one",
    Cause.VALVE_DIFFERS: "the valve does not move as configured; measure it: positioner identify",
    Cause.HUNTING: "the stem swings without an end; measure the valve: positioner identify",
    Cause.NO_MOTION: "pushes move neither the stem nor its reading; look at sensor and stem",
}


DISARMED_BY: Mapping[Cause, str] = {
    Cause.DISARMED: "another host has disarmed the positioner",
    Cause.FOREIGN_COMMAND: "the positioner has disarmed itself, because another controller commands this valve",
    Cause.WAITING_FOR_ARM: "the positioner has started again and is not armed",
}
"""Why a positioner that was armed is so no more, where its host did not disarm it."""


def end_line(status: PositionerStatus | None, guard: GuardSettings) -> str:
    """Return what a positioner with this status, None for a silent one, does when its host sends no more setpoints."""
    ended = "no more setpoints are sent"
    if status is None:
        return f"{ended}; the positioner is silent"
    if _is_tested(status):
        return f"{ended}; a test procedure moves the valve and goes on without; `disarm` ends it"
    mode = status.mode
    if mode is Mode.FAILSAFE:
        return f"{ended}: the positioner stays in FAILSAFE until it is armed again; `disarm` makes it command nothing"
    if mode in {Mode.INIT, Mode.READY}:
        return f"{ended}; the positioner is not armed and commands nothing"
    hold = f"holds within {guard.setpoint_hold_s:g} s" if guard.setpoint_hold_s else "goes on"
    failsafe = f" and fails safe after {guard.setpoint_failsafe_s:g} s" if guard.setpoint_failsafe_s else ""
    return f"{ended}: the positioner {hold}{failsafe}; `disarm` makes it command nothing"


def state_in_words(status: PositionerStatus) -> str:
    """Return mode, cause and NE 107 signal in one line."""
    cause = "a test procedure moves the valve" if _is_tested(status) else CAUSES[status.cause]
    return f"{status.mode.name}: {cause} (NE 107: {in_words(status.health)})"


def _is_tested(status: PositionerStatus) -> bool:
    return status.cause is Cause.NONE and status.health is Health.FUNCTION_CHECK


ALARMS = (
    *("friction risen", "friction fallen", "slip jump", "spring rate", "spring force", "one direction"),
    *("end position", "travel deviation", "response time", "cycles", "travel", "stroke test", "stuck", "hunting"),
)
"""The causes of alarms, by their bits."""


def alarms_in_words(alarms: PositionerAlarms | None) -> str:
    """Return the alarms of the valve's condition in one line."""
    if alarms is None:
        return "none"
    told = []
    for bit, name in enumerate(ALARMS):
        is_new = alarms.unacknowledged >> bit & 1
        if alarms.active >> bit & 1:
            told.append(name + (" (new)" if is_new else ""))
        elif is_new:
            told.append(f"{name} (over, not acknowledged)")
    if not told:
        return "none"
    return f"{', '.join(told)} (NE 107: {in_words(alarms.worst)}; see `positioner health`)"


def status_counts(status: PositionerStatus) -> tuple[int, int, int]:
    """Return the counters of the status, which count modulo 256, in the order in which they are told."""
    return status.learned_count, status.rejected_count, status.fallback_count


def named_counters(own: tuple[int, int, int], counts: Mapping[Counted, int]) -> tuple[tuple[str, int], ...]:
    """Return the counters of the status, and what the positioner counts by its cause, each with its name."""
    by_cause = ((cause.text, count) for cause, count in sorted(counts.items()))
    return (*zip(("learned", "refused", "fallbacks"), own, strict=True), *by_cause)


def counters_in_words(counters: Sequence[tuple[str, int]]) -> str:
    """Return counters with their names in one line."""
    return ", ".join(f"{name} {count}" for name, count in counters)


def in_mm(position_m: float, span_m: float) -> str:
    """Return a position in mm and in percent of the span."""
    return f"{position_m * 1e3:.2f} mm ({100.0 * position_m / span_m:.2f} %)"
