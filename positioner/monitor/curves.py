"""The trend of a valve as two small plots of text: position with setpoint, and current. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.monitor.canvas import DOTS_HIGH, DOTS_WIDE, NO_PLAIN, Canvas
from positioner.monitor.trend import BIN_NS
from positioner.report.scale import scale

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from positioner.monitor.trend import Bin
    from positioner.report.scale import Scale

    Range = tuple[float, float]
    Ranged = tuple[list[Range | None], set[int]]
    Runs = list[tuple[str, str]]

POSITION, SETPOINT, CURRENT, FRAME = "position", "setpoint", "command", "frame"
"""The pens; a view gives each its colour."""
LABEL_WIDTH = 9
LEAST_WIDTH, LEAST_HEIGHT = 2 * LABEL_WIDTH, 4
"""In less room there is no plot."""
_WITH_TIMES = 6
"""From so many rows on the last one has the times."""
_ROWS_PER_LABEL, _COLUMNS_PER_TIME = 3, 14
_MM = 1e3
_NS = 1_000_000_000
_LEAST_MM, _LEAST_MA = 0.5, 0.2


def plots(
    bins: Sequence[Bin],
    window_s: float,
    now_ns: int,
    width: int,
    height: int,
    late_s: float,
    plain: Mapping[str, str] = NO_PLAIN,
) -> list[Runs]:
    """Return the rows of both plots, `width` × `height` characters with their labels, over the last `window_s`.

    Between readings, or commands, that are more than `late_s` apart there is no line.
    """
    times = [_times(window_s, width)] if height >= _WITH_TIMES else []
    height -= len(times)
    current_rows = max(height // 3, 2)
    columns = (width - LABEL_WIDTH) * DOTS_WIDE
    place = _columns(window_s, now_ns, columns)
    apart = 1 + math.ceil(late_s * _NS / BIN_NS)
    position = _ranged(bins, place, columns, apart, lambda each: _in_mm(each.position_mean_m))
    setpoint = _ranged(bins, place, columns, apart, lambda each: _in_mm(each.setpoint_m))
    current = _ranged(bins, place, columns, apart, lambda each: _pair(each.current_low_ma, each.current_high_ma))
    upper = _plot(((position, POSITION), (setpoint, SETPOINT)), width, height - current_rows, _LEAST_MM, "mm", plain)
    rows = [*upper, *_plot(((current, CURRENT),), width, current_rows, _LEAST_MA, "mA", plain), *times]
    return [[(_as_ascii(text), pen) for text, pen in row] for row in rows] if plain else rows


def _plot(
    series: Sequence[tuple[Ranged, str]],
    width: int,
    height: int,
    least: float,
    unit: str,
    plain: Mapping[str, str],
) -> list[Runs]:
    canvas = Canvas(width - LABEL_WIDTH, height)
    axis = _axis([point for (points, _), _ in series for point in points if point is not None], least, height)
    for (points, parted), pen in series:
        scaled = [None if p is None else (axis.at(p[0]), axis.at(p[1])) for p in points]
        canvas.series(scaled, pen, dashed=pen == SETPOINT, parted=parted)
    labels, ticks = [""] * height, axis.ticks
    for tick in (ticks[0], ticks[-1], *ticks):  # where rows are few, the ends are named
        row = height - 1 - round((height * DOTS_HIGH - 1) * axis.at(tick)) // DOTS_HIGH
        labels[row] = labels[row] or axis.label(tick)
    labels[-1] += f" {unit}"
    return [
        [(f"{label:>{LABEL_WIDTH - 1}.{LABEL_WIDTH - 1}} ", FRAME), *row]
        for label, row in zip(labels, canvas.rows(plain), strict=True)
    ]


def _axis(points: Sequence[Range], least: float, height: int) -> Scale:
    """Return an axis from 0 to 1 that holds all points, is at least `least` long, and begins and ends at round ones."""
    low, high = min((low for low, _ in points), default=0.0), max((high for _, high in points), default=1.0)
    more = max(least - (high - low), 0.0) / 2.0
    return scale((low - more, high + more), 0.0, 1.0, max(height // _ROWS_PER_LABEL, 1))


def _times(window_s: float, width: int) -> Runs:
    """Return the row below the plots: round times before now, each under its column."""
    columns = width - LABEL_WIDTH
    axis = scale((-window_s, 0.0), 0.0, 1.0, max(columns // _COLUMNS_PER_TIME, 1), tight=True)
    line = [" "] * width
    for tick in axis.ticks:
        name = f"{axis.label(tick)} s"
        at = min(LABEL_WIDTH + round((columns - 1) * axis.at(tick)), width - len(name))
        line[at : at + len(name)] = name
    return [("".join(line), FRAME)]


def _as_ascii(text: str) -> str:
    return text.replace("\N{MINUS SIGN}", "-").replace("\N{NARROW NO-BREAK SPACE}", " ")


def _columns(window_s: float, now_ns: int, columns: int) -> Callable[[int], int]:
    """Return the function from the number of a bin to its column; columns do not move within themselves."""
    per_column = max(window_s * _NS / BIN_NS / columns, 1e-9)
    newest = math.floor(now_ns // BIN_NS / per_column)
    return lambda number: columns - 1 - newest + math.floor(number / per_column)


def _ranged(
    bins: Sequence[Bin], place: Callable[[int], int], columns: int, apart: int, of: Callable[[Bin], Range | None]
) -> Ranged:
    """Return the range of each column, and the columns before which nothing came for `apart` bins."""
    points: list[Range | None] = [None] * columns
    parted, newest = set[int](), None
    for each in bins:
        x, value = place(each.number), of(each)
        if value is None or not 0 <= x < columns:
            continue
        before = points[x]
        points[x] = value if before is None else (min(before[0], value[0]), max(before[1], value[1]))
        if newest is not None and each.number - newest >= apart and before is None:
            parted.add(x)
        newest = each.number
    return points, parted


def _pair(low: float | None, high: float | None) -> Range | None:
    return None if low is None or high is None else (low, high)


def _in_mm(value_m: float | None) -> Range | None:
    return None if value_m is None else (value_m * _MM, value_m * _MM)
