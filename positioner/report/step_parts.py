"""The figures and the table of a step response test, by size and direction. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from positioner.report import words
from positioner.report.chart import Chart
from positioner.report.layers import Line
from positioner.report.page import Status, Verdict
from positioner.report.table import Table

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from positioner.report.layers import Layer

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
    rows = tuple([_row(size, sides) for size, sides in by_size.items()])
    return Table(head, rows, "Medians by step size, up and down where they differ")


def _row(size: float, sides: list[dict[str, Any]]) -> tuple[str, ...]:
    moved, responses = (sum(each[key] for each in sides) for key in ("moved", "responses"))
    figures = (_of_sides([_figure(each[key]["median"], factor) for each in sides]) for key, _, factor in _FIGURES)
    return (f"{100.0 * size:g} %", str(sides[0]["region"]), f"{moved} of {responses}", *figures)


def _figure(value: float | None, factor: float) -> str:
    scaled = None if value is None else value * factor
    return words.number(scaled, min(words.decimals_of(scaled or 0.0, 3), 2))


def _of_sides(texts: list[str]) -> str:
    return texts[0] if len(set(texts)) == 1 else " / ".join(texts)


def step_charts(document: dict[str, Any], reference: dict[str, Any] | None) -> tuple[Chart, ...]:
    """Return T86 and gain over the size of the step, over those of an earlier test."""
    charts = list(_responses(document))
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
        charts.append(
            Chart(
                title, f"step, % of {document.get('input', 'span')}", label, tuple(layers), from_zero=True, names=names
            )
        )
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
            yield Chart(f"Responses to {100.0 * size:g} %", "time, ms", "part of the step", tuple(layers))


def step_verdict(document: dict[str, Any]) -> Verdict | None:
    """Return whether the limits are kept, None where there are none."""
    broken = document.get("broken", ())
    if broken:
        sentence = f"The step test breaks {len(broken)} of its limits: {broken[0]}."
        return Verdict(Status.OUT_OF_SPECIFICATION, sentence, "Compare with the signature, and with the reference.")
    return Verdict(Status.GOOD, "The step test keeps its limits.", "Nothing.") if document.get("limits") else None


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
