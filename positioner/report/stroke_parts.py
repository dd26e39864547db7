"""The figures, rows and verdict of a partial stroke test. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from positioner.commissioning.stroke.result import STICKS
from positioner.report import words
from positioner.report.chart import Chart
from positioner.report.layers import Line
from positioner.report.page import Status, Verdict

if TYPE_CHECKING:
    from collections.abc import Sequence

_STUCK = "stuck"


def stroke_facts(document: dict[str, Any], reference: dict[str, Any] | None) -> tuple[tuple[str, str], ...]:
    """Return the quantities with their units, and the change since an earlier test."""
    earlier = reference["quantities"] if reference else {}
    facts = []
    for name, value in document["quantities"].items():
        change = words.change(earlier.get(name), value)
        told = f"{words.number(value)} {document['units'][name]}" if value is not None else words.NOT_MEASURED
        facts.append((name, told if change == words.NONE else f"{told} ({change})"))
    return tuple(facts)


def stroke_charts(document: dict[str, Any], reference: dict[str, Any] | None) -> tuple[Chart, ...]:
    """Return travel and current over the time of the test, over those of an earlier one."""
    charts = []
    for column, title, label, factor in ((1, "Travel", "mm", 1e3), (2, "Current", "mA", 1.0)):
        layers = [
            Line(_column(each, 0), _column(each, column, factor), style if reference else "", style)
            for each, style in ((reference, "reference"), (document, "now"))
            if each is not None and each["trace"]
        ]
        if layers:
            charts.append(Chart(f"{title} during the stroke", "time, s", label, tuple(layers)))
    return tuple(charts)


def _column(document: dict[str, Any], number: int, factor: float = 1.0) -> Sequence[float]:
    return [float("nan") if row[number] is None else float(row[number]) * factor for row in document["trace"]]


def stroke_verdict(document: dict[str, Any]) -> Verdict:
    """Return what a test says of the valve: a stuck stem is a failure, any other failed test asks for work."""
    cause = str(document["cause"])
    if document["verdict"] == "passed":
        return Verdict(Status.GOOD, "The stroke test was passed.", "Nothing.")
    if document["verdict"] != "failed":
        return Verdict(
            Status.FUNCTION_CHECK, f"The stroke test was ended: {cause}.", "Repeat it: positioner stroke-test."
        )
    told = [str(each["text"]) for each in document["findings"]]
    told += [str(document["stop"]["why"])] if document["stop"] else []
    sentence = f"The stroke test failed: {'; '.join(told) or cause}."
    if _STUCK in cause:
        air = "" if document.get("suspects") == [STICKS] else "Look at the air supply, for it may be slow or missing. "
        remedy = f"{air}Free the stem or remove the obstacle; its output cannot be trusted."
        return Verdict(Status.FAILURE, sentence, remedy)
    return Verdict(Status.MAINTENANCE_REQUIRED, sentence, "Look at packing and air supply, then repeat the test.")
