"""The figures in tables for people, and as values for programs. Pure."""

from __future__ import annotations

import math
from dataclasses import asdict, replace
from typing import TYPE_CHECKING

from positioner.inputs.durations import duration
from positioner.reach.figures import MOVE_OF_SPAN
from positioner.reach.moves import SETTLED_OF_SPAN
from positioner.report.table import Table

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from positioner.reach.case import Case
    from positioner.reach.figures import Figures
    from positioner.reach.improvements import Improvement
    from positioner.report.text import Block


def as_values(case: Case, figures: Figures, changes: Sequence[Improvement]) -> dict[str, object]:
    """Return everything in SI units; what has no finite value is None."""
    return {
        "valve": case.valve.id,
        "sample_period_s": case.period_s,
        "noise_m": case.sigma_m,
        **_finite(figures),
        "improvements": [{"change": each.change, **_finite(each.figures)} for each in changes],
    }


def _finite(figures: Figures) -> dict[str, float | None]:
    return {key: value if math.isfinite(value) else None for key, value in asdict(figures).items()}


def blocks(case: Case, figures: Figures, changes: Sequence[Improvement], bus_load: str) -> Iterator[Block]:
    """Yield the figures, and what would improve them, for a person."""
    yield f"{case.valve.id}: what this valve can reach, computed from its configuration"
    for title, rows in _sections(case, figures, bus_load):
        yield ""
        yield replace(Table.of(("", ""), rows), caption=title)
    yield ""
    if not changes:
        yield "nothing of what was tried would improve it: noise, period, lags, dead time, packing"
        return
    head = ("change", "first move, 1 σ, mm", "in %", "mean error, mm", "in %", "duration, ms")
    helped = [
        (
            each.change,
            *_cells(each.figures.first_m, case),
            *_cells(each.figures.error_m, case),
            _milliseconds(each.figures.mean_s),
        )
        for each in changes
    ]
    yield replace(Table.of(head, helped), caption="what would improve it, one change at a time")


def _sections(case: Case, found: Figures, bus_load: str) -> Iterator[tuple[str, list[tuple[str, str]]]]:
    loop = f"{case.low_ma:g} to {case.high_ma:g} mA"
    yield (
        "where the stem can be",
        [
            (f"{loop} slide it to", _range(found.low_reach_m, found.high_reach_m)),
            ("and free it both ways", _range(found.low_m, found.high_m)),
        ],
    )
    yield (
        "the smallest moves",
        [
            ("natural jump (F_s - F_c)/K", _length(found.natural_jump_m, case)),
            (f"push of one period, {case.period_s * 1e3:g} ms", _length(found.push_m, case)),
        ],
    )
    yield (
        "the error that is left",
        [
            ("noise of a reading, 1 σ", _length(case.sigma_m, case)),
            ("of the mean of one second", _length(found.averaged_m, case)),
            ("of the end of a first move", f"{_length(found.first_m, case)}, once friction and lag are known"),
            ("mean error to expect", _length(found.error_m, case)),
        ],
    )
    yield (
        f"a move by {MOVE_OF_SPAN:.0%} of span, to {SETTLED_OF_SPAN:.0%} of it",
        [
            ("shortest possible", _duration(found.shortest_s)),
            ("of the law, without correction", _duration(found.law_s)),
            ("a correction adds", f"{_duration(found.correction_s)}, in {found.share:.0%} of the moves"),
            ("mean, with corrections", _duration(found.mean_s)),
        ],
    )
    yield ("the bus", [("load", bus_load)])


def _range(low_m: float, high_m: float) -> str:
    if low_m > high_m:
        return "nowhere"
    return f"{low_m * 1e3:.1f} to {high_m * 1e3:.1f} mm"


def _length(length_m: float, case: Case) -> str:
    length_mm, percent = _cells(length_m, case)
    return f"{length_mm} mm ({percent} %)"


def _cells(length_m: float, case: Case) -> tuple[str, str]:
    """Return a length in mm and in percent of the span."""
    length_mm, percent = length_m * 1e3, 100.0 * length_m / case.valve.span_m
    return f"{length_mm:.{_digits(length_mm)}f}", f"{percent:.{_digits(percent)}f}"


def _milliseconds(duration_s: float) -> str:
    duration_ms = duration_s * 1e3
    return f"{duration_ms:.{_digits(duration_ms)}f}" if math.isfinite(duration_s) else "never"


def _duration(duration_s: float) -> str:
    if not math.isfinite(duration_s):
        return "never: the current is too weak"
    return duration(duration_s, 3)


def _digits(value: float) -> int:
    """Return how many decimals show two digits of a value."""
    return min(max(1 - math.floor(math.log10(value)), 0), 4) if value > 0.0 else 0
