"""The figures of an identification: the readings beside the fitted valve; and whether it is a result. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from positioner.report.chart import Chart
from positioner.report.layers import Line
from positioner.report.page import Status, Verdict

if TYPE_CHECKING:
    from positioner.report.layers import Layer

    Document = dict[str, Any]

_MM = _MS = 1e3


def identify_charts(document: Document, reference: Document | None) -> tuple[Chart, ...]:  # noqa: ARG001 - residuals are of one fit
    """Return the residuals of strokes, breakaways and steps: means of neighbours, and what counts as explained."""
    charts: list[Chart] = []
    parts: list[Document] = document.get("residuals", [])
    for kind in dict.fromkeys(part["kind"] for part in parts):
        chosen = [part for part in parts if part["kind"] == kind]
        named: set[str] = set()
        layers: list[Layer] = []
        for part in chosen:
            x = [_MM * point[0] for point in part["curve"]]
            way = part["direction"]
            layers.append(Line(x, [_MM * point[1] for point in part["curve"]], "" if way in named else way, way))
            named.add(way)
        ends = [end for layer in layers for end in (min(layer.xs()), max(layer.xs()))]
        most_mm = _MM * min(part["most_m"] for part in chosen)
        for side, name in ((1.0, "explained within"), (-1.0, "")):
            layers.append(Line([min(ends), max(ends)], 2 * [side * most_mm], name, "reference"))
        label = "travel, mm" if kind == "strokes" else "time after the slip was seen, ms"
        title = f"Readings beside the fitted valve: {kind}"
        charts.append(Chart(title, label, "mm", tuple(layers)))
    return tuple(charts)


def identify_verdict(document: Document) -> Verdict | None:
    """Return that the fit is no result, None where it is one."""
    parts = [part for part in document.get("residuals", ()) if not part["explained"]]
    if not parts:
        return None
    names = "; ".join(", ".join(each for each in (p["kind"], p["phase"], p["direction"]) if each) for p in parts)
    sentence = f"The fitted valve does not explain its record: {names}."
    return Verdict(Status.OUT_OF_SPECIFICATION, sentence, "Do not use the values: find what the model does not know.")
