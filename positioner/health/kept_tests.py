"""What the kept results of test procedures say of the valve's condition. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from positioner.health.alarms import Watched
from positioner.health.causes import AlarmCause

if TYPE_CHECKING:
    from collections.abc import Mapping

_FAILED, _STUCK = 1.0, 2.0
_STUCK_CAUSES = ("stuck, breakaway too high", "no motion in time")
"""As `commissioning.stroke.memory.Cause` has them."""


def stroke_test_watched(recorded: str, document: Mapping[str, Any]) -> Watched:
    """Return 0 after a stroke test that passed, 1 after one that failed, and 2 where the stem was stuck.

    An aborted test that no fault of the valve ended says nothing, and counts as passed.
    """
    stop = document["stop"]
    why = "" if stop is None else str(stop["cause"])
    if why in _STUCK_CAUSES:
        return Watched(AlarmCause.STROKE_TEST, _STUCK, 0.0, f"{why}, in the test of {recorded}")
    findings = ", ".join([str(each["limit"]) for each in document["findings"]])
    if document["verdict"] == "failed":
        return Watched(AlarmCause.STROKE_TEST, _FAILED, 0.0, f"{findings or 'failed'}, in the test of {recorded}")
    return Watched(AlarmCause.STROKE_TEST, 0.0, 0.0, f"passed on {recorded}")


def response_watched(recorded: str, newest: Mapping[str, Any], reference: Mapping[str, Any]) -> Watched | None:
    """Return the largest T86 over that of the same step of the reference; None where no step is common."""
    before = _responses(reference)
    ratios = [(t86_s / before[key], key) for key, t86_s in _responses(newest).items() if key in before]
    if not ratios:
        return None
    ratio, (size, direction) = max(ratios)
    text = f"T86 of steps of {size:g} % {direction}, in the test of {recorded}"
    return Watched(AlarmCause.RESPONSE_TIME, ratio, 0.0, text)


def _responses(document: Mapping[str, Any]) -> dict[tuple[float, str], float]:
    """Return the median T86 in s by size and direction."""
    found = {}
    for each in document["sizes"]:
        median = each["t86_s"]["median"]
        if median:
            found[float(each["size"]), str(each["direction"])] = float(median)
    return found
