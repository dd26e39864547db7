"""The result of a stroke test in words and for programs: verdict, rows, remarks, rows of a reference. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from positioner.commissioning.report import Row

if TYPE_CHECKING:
    from collections.abc import Sequence

    from positioner.commissioning.stroke.result import StrokeResult
    from positioner.commissioning.stroke.settings import StrokeSettings
    from positioner.valve.parameters import ValveParameters

_MM = 1e3
NO_CREDIT = (
    "This test shows the condition of the valve. It is no proof test of a safety function and earns no safety "
    "integrity level (IEC 61508, IEC 61511): the positioner is no safety device. It shows neither leakage, nor a "
    "damaged seat, nor whether the valve closes fully."
)
_COMPARED = ("breakaway, mean", "lag", "time out", "time back")


def rows(found: StrokeResult) -> tuple[Row, ...]:
    """Return the quantities of the test; one that it did not come to is not seen."""
    row = Row.exact
    return (
        row("start", "mm", found.start_m * _MM),
        row("stroke", "mm", abs(found.reached_m - found.start_m) * _MM),
        row("furthest", "mm", abs(found.furthest_m - found.start_m) * _MM),
        row("back at the start within", "mm", abs(found.back_m - found.start_m) * _MM),
        row("natural jump, predicted", "mm", found.jump_m * _MM),
        row("natural jump, seen", "mm", found.jumped_m * _MM),
        row("breakaway, out", "N", found.out_n),
        row("breakaway, back", "N", found.back_n),
        row("breakaway, mean", "N", found.static_n),
        row("of the configured friction", "%", 100.0 * found.friction_ratio),
        row("lag", "ms", found.lag_s * _MM),
        row("lag, expected", "ms", found.expected_lag_s * _MM),
        row("time out", "s", found.out_s),
        row("time back", "s", found.home_s),
        row("noise of the position", "mm", found.sigma_m * _MM),
        row("found at", "mm", found.found_m * _MM),
        row("duration", "s", found.lasted_s),
    )


def verdict_line(found: StrokeResult, valve: ValveParameters) -> str:
    """Return the verdict, with its cause and all that it may come from, in one line."""
    words = [f"{valve.id}: stroke test {found.verdict}", found.cause, suspects_in_words(found.suspects)]
    return ": ".join(each for each in words if each)


def suspects_in_words(suspects: Sequence[str]) -> str:
    """Return what may be the matter, and why it cannot be told apart where it cannot."""
    return ", or ".join(suspects) + (" (no pressure is measured)" if len(suspects) > 1 else "")


def remarks(found: StrokeResult) -> tuple[str, ...]:
    """Return what a person should know besides the values, a line each; the last one is what the test does not show."""
    lines = []
    if found.elsewhere:
        where = f"{found.found_m * _MM:.1f} mm to {found.start_m * _MM:.1f} mm"
        lines.append(f"first moved from {where}, and left at {found.left_m * _MM:.1f} mm: {found.elsewhere}")
    if found.stop:
        stop = found.stop
        where = f"at {stop.current_ma:.2f} mA, {stop.position_m * _MM:.2f} mm, {stop.time_s:.2f} s"
        lines.append(f"{stop.cause}: {stop.why}; {where}")
    if found.suspects:
        lines.append(f"{suspects_in_words(found.suspects)}: look at packing, air supply and I/P converter")
    if found.ended_by:
        lines.append(f"{found.ended_by}; after {found.lasted_s:.2f} s")
    lines += [each.text for each in found.findings]
    if found.jump_m > 0.0:
        text = f"a stem with the configured friction jumps by {found.jump_m * _MM:.1f} mm at its breakaway"
        lines.append(text + (": the stroke cannot be smaller" if found.jump_m > found.stroke_m else ""))
    return (*lines, NO_CREDIT)


def as_json(found: StrokeResult, valve: ValveParameters, settings: StrokeSettings) -> dict[str, Any]:
    """Return the result for a program, and for a later comparison; what the test did not come to is None."""
    stop = found.stop
    return {
        "valve": valve.id,
        "verdict": str(found.verdict),
        "cause": found.cause,
        "stop": stop
        and {
            "cause": str(stop.cause),
            "why": stop.why,
            "current_ma": stop.current_ma,
            "position_m": stop.position_m,
            "time_s": stop.time_s,
        },
        "suspects": list(found.suspects),
        "ended_by": found.ended_by,
        "findings": [{"limit": str(each.limit), "text": each.text} for each in found.findings],
        "quantities": {row.name: row.value if row.seen else None for row in rows(found)},
        "units": {row.name: row.unit for row in rows(found)},
        "settings": settings.as_json(),
        "trace": [list(point) for point in found.trace],
        "remarks": list(remarks(found)),
    }


def compared(found: StrokeResult, reference: dict[str, Any]) -> list[dict[str, Any]]:
    """Return as rows what an earlier test, as its JSON, has of the quantities by which tests are compared."""
    before = reference.get("quantities", {})
    return [
        {"name": row.name, "unit": row.unit, "value": before[row.name]}
        for row in rows(found)
        if row.name in _COMPARED and before.get(row.name) is not None
    ]
