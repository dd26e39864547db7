"""The figures of a signature: the loop and the friction along the travel, over those of the reference. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from positioner.report.chart import Chart
from positioner.report.layers import Line, Marks

if TYPE_CHECKING:
    from collections.abc import Sequence

    from positioner.report.layers import Layer

_MM = 1e3


def signature_charts(document: dict[str, Any], reference: dict[str, Any] | None) -> tuple[Chart, ...]:
    """Return the figures of a signature, the JSON of `positioner signature`, over those of an earlier one."""
    loops: list[Layer] = []
    friction: list[Layer] = []
    for each, style, label in ((reference, "reference", "reference"), (document, "now", "now")):
        if each is not None:
            named = label if reference is not None else ""
            for number, line in enumerate(each.get("loop", ())):
                x = _numbers(line["position_m"], _MM)
                loops.append(Line(x, _numbers(line["pressure_ma"]), named if number == 0 else "", style))
            places = each["sliding_friction_by_place"]
            x, y = _numbers((row[0] for row in places), _MM), _numbers(row[1] for row in places)
            friction.append(Line(x, y, "sliding" if label == "now" else label, style))
    for direction, mark, label in ((1.0, "up", "opening"), (-1.0, "down", "closing")):
        chosen = [row for row in document["breakaways"] if row[1] == direction]
        x, y = _numbers((row[0] for row in chosen), _MM), _numbers(row[2] for row in chosen)
        friction.append(Marks(x, y, label, mark))
    loop = (
        (Chart("Loop: pressure over travel", "travel, mm", "pressure as current, mA", tuple(loops)),) if loops else ()
    )
    return (
        *loop,
        Chart("Friction, sliding and at breakaways", "travel, mm", "force, N", tuple(friction), from_zero=True),
    )


def _numbers(values: Any, factor: float = 1.0) -> Sequence[float]:
    return [float("nan") if each is None else float(each) * factor for each in values]
