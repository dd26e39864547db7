"""The figures of a signature over those of the reference, and its verdict. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from positioner.report.chart import Chart
from positioner.report.layers import Line, Marks
from positioner.report.page import Status, Verdict

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


def signature_verdict(document: dict[str, Any]) -> Verdict | None:
    """Return what a signature says of the valve, by the limits of its changes since the reference; None without one."""
    if not document["compared"]:
        return None
    broken = document["beyond_limits"]
    if not broken:
        return Verdict(Status.GOOD, "Spring and friction are those of the reference, within the limits.", "Nothing.")
    told = [str(each["text"]).partition(": look")[0] for each in broken]
    worst = any(each["category"] != "maintenance_required" for each in broken)
    status = Status.OUT_OF_SPECIFICATION if worst else Status.MAINTENANCE_REQUIRED
    remedy = str(broken[0]["text"]).rpartition(": ")[2]
    return Verdict(status, f"Since the reference: {'; '.join(told)}.", f"{remedy[:1].upper()}{remedy[1:]}.")
