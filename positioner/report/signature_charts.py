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
_SIDES = ("closing", "opening")
_FITTED = {"spring": "spring", "friction": "with friction"}


def signature_charts(document: dict[str, Any], reference: dict[str, Any] | None) -> tuple[Chart, ...]:
    """Return the figures of a signature, the JSON of `positioner signature`, over those of an earlier one."""
    loops: list[Layer] = []
    friction: list[Layer] = []
    for each, style, label in ((reference, "reference", "reference"), (document, "now", "now")):
        if each is not None:
            for number, line in enumerate(each.get("loop", ())):
                side = _SIDES[line["direction"] > 0.0] if style == "now" else style
                name = side if style == "now" or number == 0 else ""
                loops.append(Line(_numbers(line["position_m"], _MM), _numbers(line["pressure_ma"]), name, side))
            places = each["sliding_friction_by_place"]
            x, y = _numbers((row[0] for row in places), _MM), _numbers(row[1] for row in places)
            friction.append(Line(x, y, "sliding" if label == "now" else label, style))
    for name, ends in document.get("fitted", {}).items():
        for number, pressures in enumerate(ends["pressure_ma"]):
            x, y = _numbers(ends["position_m"], _MM), _numbers(pressures)
            loops.append(Line(x, y, "" if number else _FITTED[name], name))
    for direction, mark, label in ((1.0, "up", "static, opening"), (-1.0, "down", "static, closing")):
        chosen = [row for row in document["breakaways"] if row[1] == direction]
        x, y = _numbers((row[0] for row in chosen), _MM), _numbers(row[2] for row in chosen)
        friction.append(Marks(x, y, label, mark))
    loop = (Chart("Loop: pressure, as the current that holds it", "travel, mm", "mA", tuple(loops)),) if loops else ()
    return (*loop, Chart("Friction along the travel", "travel, mm", "force, N", tuple(friction), from_zero=True))


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
