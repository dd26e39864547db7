"""The figures and the table of a step response test, by size and direction. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from positioner.report import words
from positioner.report.chart import Chart, Layer, Line
from positioner.report.page import Table

if TYPE_CHECKING:
    from collections.abc import Sequence

_FIGURES = (
    ("dead_time_s", "Td, ms", 1e3),
    ("t63_s", "T63, ms", 1e3),
    ("t86_s", "T86, ms", 1e3),
    ("overshoot", "overshoot, %", 1e2),
    ("gain", "gain", 1.0),
)


def step_table(document: dict[str, Any]) -> Table:
    """Return a row for each size and direction: medians of the responses."""
    head = ("step", "region", "moved", *(name for _, name, _ in _FIGURES))
    return Table(head, tuple(_row(each) for each in document["sizes"]), "Medians by step size and direction")


def _row(size: dict[str, Any]) -> tuple[str, ...]:
    name = f"{100.0 * size['size']:g} % {size['direction']}"
    medians = (_scaled(size[key]["median"], factor) for key, _, factor in _FIGURES)
    figures = (words.number(each, min(words.decimals_of(each or 0.0, 3), 2)) for each in medians)
    return (name, str(size["region"]), f"{size['moved']} of {size['responses']}", *figures)


def step_charts(document: dict[str, Any], reference: dict[str, Any] | None) -> tuple[Chart, ...]:
    """Return T86 and gain over the size of the step, over those of an earlier test."""
    charts = []
    for key, title, label in (
        ("t86_s", "Response time by step size", "T86, ms"),
        ("gain", "Travel gain by step size", "gain"),
    ):
        factor = 1e3 if key == "t86_s" else 1.0
        names = tuple(f"{100.0 * each:g} %" for each in sorted({row["size"] for row in document["sizes"]}))
        layers: list[Layer] = []
        if reference is not None:
            layers.append(_line(reference, names, key, factor, "up", "reference", "reference"))
        layers.append(_line(document, names, key, factor, "up", "now", "up"))
        layers.append(_line(document, names, key, factor, "down", "fit", "down"))
        charts.append(Chart(title, "step, % of span", label, tuple(layers), from_zero=True, names=names))
    return tuple(charts)


def _line(
    document: dict[str, Any], names: Sequence[str], key: str, factor: float, side: str, style: str, label: str
) -> Line:
    found = {
        f"{100.0 * row['size']:g} %": _scaled(row[key]["median"], factor)
        for row in document["sizes"]
        if row["direction"] == side
    }
    heights = [float("nan") if found.get(name) is None else float(found[name] or 0.0) for name in names]
    return Line([float(number) for number in range(len(names))], heights, label, style)


def _scaled(value: float | None, factor: float) -> float | None:
    return None if value is None else value * factor
