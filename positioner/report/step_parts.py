"""The figures and the table of a step response test, by size and direction. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from positioner.commissioning.step.report import time_decimals
from positioner.report import words
from positioner.report.chart import Chart
from positioner.report.layers import Line, Marks
from positioner.report.page import Status, Verdict
from positioner.report.table import Table

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from positioner.report.layers import Layer

_PERCENT = 100.0
_FINE_S = 1e-4
"""The sample period of a result that does not name it."""
_FIGURES = (
    ("dead_time_s", "Td, ms", 1e3),
    ("t63_s", "T63, ms", 1e3),
    ("t86_s", "T86, ms", 1e3),
    ("overshoot", "overshoot, %", 1e2),
    ("gain", "gain", 1.0),
)


def step_table(document: dict[str, Any]) -> Table:
    """Return a row for each size: medians of the responses, up and down."""
    by_size: dict[float, list[dict[str, Any]]] = {}
    for each in document["sizes"]:
        by_size.setdefault(each["size"], []).append(each)
    head = ("step", "region", "moved", *(name for _, name, _ in _FIGURES))
    period_s = document.get("period_s", _FINE_S)
    rows = tuple([_row(size, sides, time_decimals(period_s)) for size, sides in by_size.items()])
    within = f"; times ±{1e3 * document['period_s']:g} ms, the sample period" if "period_s" in document else ""
    return Table(head, rows, f"Medians by step size, up and down where they differ{within}")


def _row(size: float, sides: list[dict[str, Any]], of_times: int) -> tuple[str, ...]:
    moved, responses = (sum(each[key] for each in sides) for key in ("moved", "responses"))
    figures = (
        _of_sides([_figure(each[key]["median"], factor, of_times if key.endswith("_s") else 2) for each in sides])
        for key, _, factor in _FIGURES
    )
    return (f"{100.0 * size:g} %", str(sides[0]["region"]), f"{moved} of {responses}", *figures)


def _figure(value: float | None, factor: float, most_decimals: int) -> str:
    scaled = None if value is None else value * factor
    return words.number(scaled, min(words.decimals_of(scaled or 0.0, 3), most_decimals))


def _of_sides(texts: list[str]) -> str:
    return texts[0] if len(set(texts)) == 1 else " / ".join(texts)


def step_charts(document: dict[str, Any], reference: dict[str, Any] | None) -> tuple[Chart, ...]:
    """Return T86 and gain over the size of the step, over those of an earlier test with steps of the same input."""
    charts = list(_responses(document))
    if reference is not None and reference.get("input") != document.get("input"):  # in open loop, percent of the signal
        reference = None
    regions = {row["size"]: row["region"] for row in document["sizes"] if row["region"] != "A"}
    sizes = sorted(regions)
    names = tuple(f"{_PERCENT * size:g} % {regions[size]}" for size in sizes)
    for key, title, label, factor in (
        ("t86_s", "Response time by step size", "T86, ms", 1e3),
        ("gain", "Travel gain by step size", "gain", 1.0),
    ):
        layers: list[Layer] = []
        if reference is not None:
            x, y = _medians(reference, sizes, key, factor, "up")
            layers += [Line(x, y, "reference", "reference")] if any(map(math.isfinite, y)) else []
        for side, style in (("up", "now"), ("down", "fit")):
            x, y = _medians(document, sizes, key, factor, side)
            layers += [Line(x, y, side, style), Marks(x, y, mark=side)]
        label_x = f"step, % of {document.get('input', 'span')}, and its region"
        charts.append(Chart(title, label_x, label, tuple(layers), from_zero=True, names=names))
    return tuple(charts)


def _responses(document: dict[str, Any]) -> Iterator[Chart]:
    """Yield the responses as parts of their steps, of one size each in its own chart: a small step is a quick one."""
    drawn: list[dict[str, Any]] = [each for each in document.get("responses", ()) if each["part"]]
    moving = [row["size"] for row in document["sizes"] if row["region"] != "A"]
    for size in sorted({moving[0], moving[-1]} if moving else ()):
        layers: list[Layer] = []
        for side, style in (("up", "now"), ("down", "fit")):
            own = [each for each in drawn if (each["size"], each["direction"]) == (size, side)]
            layers += [
                Line([1e3 * time for time in each["time_s"]], each["part"], side if each is own[0] else "", style)
                for each in own
            ]
        if layers:
            begin, end = min(layer.xs()[0] for layer in layers), max(layer.xs()[-1] for layer in layers)
            asked = Line([min(begin, 0.0), 0.0, 0.0, end], [0.0, 0.0, 1.0, 1.0], "the step", "reference")
            title = f"Responses to {100.0 * size:g} %"
            yield Chart(title, "time since the step, ms", "part of the step", (asked, *layers), tight=True)


def step_verdict(document: dict[str, Any]) -> Verdict | None:
    """Return whether the limits are kept, None where there are none."""
    broken = document.get("broken", ())
    if broken:
        sentence = f"The step test breaks {len(broken)} of its limits: {broken[0]}."
        return Verdict(Status.OUT_OF_SPECIFICATION, sentence, "Compare with the signature, and with the reference.")
    return Verdict(Status.GOOD, "The step test keeps its limits.", "Nothing.") if document.get("limits") else None


def _medians(
    document: dict[str, Any], sizes: Sequence[float], key: str, factor: float, side: str
) -> tuple[list[float], list[float]]:
    """Return places and medians of a quantity for these sizes, NaN where there is none."""
    found = {row["size"]: row[key]["median"] for row in document["sizes"] if row["direction"] == side}
    medians = [found.get(size) for size in sizes]
    return [float(at) for at in range(len(sizes))], [math.nan if each is None else factor * each for each in medians]
