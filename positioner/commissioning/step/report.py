"""The result of a step response test in words, and as the JSON document that is kept. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from positioner.commissioning.report import Row
from positioner.commissioning.step.sizes import QUANTITIES

if TYPE_CHECKING:
    from collections.abc import Sequence

    from positioner.commissioning.step.result import StepResult
    from positioner.commissioning.step.sizes import SizeRow, Spread

SIDES = {1.0: "up", -1.0: "down"}
_MS, _PERCENT = 1e3, 100.0
_TIMES = {"dead_time_s": "Td, ms", "t63_s": "T63, ms", "t86_s": "T86, ms", "t98_s": "T98, ms"}
_PARTS = {"overshoot": ("over, %", _PERCENT), "gain": ("gain", 1.0)}
SIZE_HEAD = ("step, %", "moved", "region", *_TIMES.values(), *(head for head, _ in _PARTS.values()))
SIZE_NOTE = "Median ± sample period (least to largest of the repeats, where they differ by more)"
BETWEEN = "lies between"
"""What `low` and `high` of the rows are: what the ladders leave open, no confidence interval."""
_BANDS = {"dead_band": "dead band", "resolution": "resolution"}
_SHORT_S = 0.1
_CERTAIN_SIGMA = 5.0


def heading(result: StepResult, valve: str, *, has_limits: bool, broken: Sequence[str]) -> str:
    """Return what was tested and whether it keeps its limits, in one line."""
    loop = "open loop" if result.plan.is_open else f"closed loop with {result.law}"
    verdict = ": a limit is broken" if broken else ": all limits are kept" if has_limits else ""
    return f"{valve}: step response test, {loop}{verdict}"


def time_decimals(period_s: float) -> int:
    """Return the decimals of a time in ms that a sample period leaves: a tenth of it, and no finer."""
    return max(1 - math.floor(math.log10(_MS * period_s) + 1e-9), 0)


def size_rows(result: StepResult) -> list[tuple[str, ...]]:
    """Return the cells of each size and direction: medians, and in parentheses the least and largest of the repeats."""
    return [
        (
            f"{_PERCENT * row.size:g} {SIDES[row.direction]}",
            f"{row.moved}/{row.count}",
            result.regions[row.size],
            *(_time_cell(row.spread(quantity), result.period_s) for quantity in _TIMES),
            *(_cell(row.spread(quantity), factor) for quantity, (_, factor) in _PARTS.items()),
        )
        for row in result.rows
    ]


def _time_cell(spread: Spread, period_s: float) -> str:
    """Return a time in ms with its uncertainty, and the repeats where they differ by more than that.

    An instant lies between two readings, a period apart, one before it and one behind it; what the readings around it
    tell between them holds for a smooth motion only, and a stem that slips has none.
    """
    if not spread.count:
        return "–"
    digits = time_decimals(period_s)
    median, low, high = (f"{_MS * each:.{digits}f}" for each in (spread.median, spread.low, spread.high))
    told = f"{median} ±{_MS * period_s:g}"
    return f"{told} ({low}–{high})" if spread.high - spread.low > period_s else told


def _cell(spread: Spread, factor: float) -> str:
    if not spread.count:
        return "–"
    median, low, high = (_number(each * factor) for each in (spread.median, spread.low, spread.high))
    return median if low == high else f"{median} ({low}–{high})"


def _number(value: float) -> str:
    if not math.isfinite(value):
        return "-"
    size = abs(value)
    return f"{value:.0f}" if size >= 100.0 else f"{value:.1f}" if size >= 10.0 else f"{value:.2f}"  # noqa: PLR2004


def band_rows(result: StepResult) -> tuple[Row, ...]:
    """Return dead band and resolution by direction, with all that the ladders leave open."""
    rows = []
    for name, words in _BANDS.items():
        for direction, side in SIDES.items():
            band = result.band(name, direction)
            if band is not None:
                value = band.median if math.isfinite(band.median) else math.nan
                unit = f"% {result.plan.unit}"
                low, high = _PERCENT * band.low, _PERCENT * band.high
                rows.append(Row(f"{words}, {side}", unit, _PERCENT * value, low, high))
    return tuple(rows)


def remarks(result: StepResult) -> tuple[str, ...]:
    """Return what a person should know besides the values, a line each."""
    plan, span_m = result.plan, result.span_m
    repeats = f"{plan.repeats} repeat{'s' * (plan.repeats > 1)}"
    short = max(_SHORT_S / result.period_s, 1.0)
    conditions = (
        f"wait {plan.wait_s:g} s, {repeats}, at {_PERCENT * plan.place:.3g} % of the {plan.unit}, "
        f"period {_MS * result.period_s:g} ms, noise {_PERCENT * result.sigma_m / span_m:.3g} % of span"
    )
    seen = (
        f"the dead time ends with a motion of {_PERCENT * result.dead_time_m / span_m:.2g} % of span; a rest that "
        f"differs by less than {_PERCENT * result.seen_m / span_m:.2g} % is no motion"
    )
    text = [conditions, seen]
    if plan.ladder:
        text.append(f"dead band and resolution: by ladders, each with the uncertainty of a step, {_rung(result)}")
        if result.rung > plan.ladder:
            text.append(f"the noise forbids ladder steps of {_PERCENT * plan.ladder:g} %: larger ones were used")
    text += [
        f"the noise forbids steps of {_PERCENT * size:g} %: they would take --repeats {count}"
        for size, count in result.refused
    ]
    hidden_m = _CERTAIN_SIGMA * result.sigma_m / math.sqrt(short)
    if result.rows and hidden_m > 0.01 * result.rows[0].size * span_m:
        text.append(f"an overshoot of less than {_PERCENT * hidden_m / span_m:.2g} % of span for 0.1 s is not seen")
    for name, words in _BANDS.items():
        for direction, side in SIDES.items():
            band = result.band(name, direction)
            if band is not None and not math.isfinite(band.median):
                text.append(f"{words}, {side}: no motion within {_PERCENT * band.low:.3g} % of {plan.unit}")
    if result.too_slow:
        text.append("responses last nearly as long as the wait: take a longer --wait")
    return tuple(text)


def _rung(result: StepResult) -> str:
    return f"{_PERCENT * result.rung:.2g} % of {result.plan.unit}"


def as_json(result: StepResult, valve: str, broken: tuple[str, ...]) -> dict[str, Any]:
    """Return the result for a program, and for a later comparison; a number that there is not is None."""
    plan = result.plan
    return {
        "valve": valve,
        "law": result.law,
        "input": plan.unit,
        "period_s": result.period_s,
        "time_uncertainty_s": result.period_s,
        "wait_s": plan.wait_s,
        "repeats": plan.repeats,
        "place": plan.place,
        "noise_of_span": result.sigma_m / result.span_m,
        "dead_time_motion_of_span": result.dead_time_m / result.span_m,
        "sizes": [_size(row, result.regions[row.size]) for row in result.rows],
        "refused": [{"size": size, "repeats": count} for size, count in result.refused],
        "ladder": _finite(result.rung),
        **{name: _bands(result, name) for name in _BANDS},
        "rows": [row.as_json() for row in band_rows(result)],
        "between": BETWEEN,
        "remarks": list(remarks(result)),
        "broken": list(broken),
    }


def _size(row: SizeRow, region: str) -> dict[str, Any]:
    figures = {name: _spread(row.spread(name)) for name in QUANTITIES}
    head = {"size": row.size, "direction": SIDES[row.direction], "responses": row.count, "moved": row.moved}
    return {**head, "region": region, **figures}


def _bands(result: StepResult, name: str) -> dict[str, Any]:
    found = {side: result.band(name, direction) for direction, side in SIDES.items()}
    return {side: _spread(band) for side, band in found.items() if band is not None}


def _spread(spread: Spread) -> dict[str, Any]:
    ends = {"median": spread.median, "low": spread.low, "high": spread.high}
    return {**{name: _finite(value) for name, value in ends.items()}, "count": spread.count}


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
