"""The trend of a valve as two small plots of text: position with setpoint, and current. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.monitor.canvas import DOTS_WIDE, NO_PLAIN, Canvas
from positioner.monitor.trend import BIN_NS

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from positioner.monitor.trend import Bin

    Range = tuple[float, float]
    Runs = list[tuple[str, str]]

POSITION, SETPOINT, CURRENT, FRAME = "position", "setpoint", "command", "frame"
"""The pens; a view gives each its colour."""
LABEL_WIDTH = 9
LEAST_WIDTH, LEAST_HEIGHT = 2 * LABEL_WIDTH, 4
"""In less room there is no plot."""
_MM = 1e3
_NS = 1_000_000_000
_LEAST_MM, _LEAST_MA = 0.5, 0.2
_HEADROOM = 0.08


def plots(
    bins: Sequence[Bin], window_s: float, now_ns: int, width: int, height: int, plain: Mapping[str, str] = NO_PLAIN
) -> list[Runs]:
    """Return the rows of both plots, `width` × `height` characters with their labels, over the last `window_s`."""
    current_rows = max(height // 3, 2)
    columns = (width - LABEL_WIDTH) * DOTS_WIDE
    place = _columns(window_s, now_ns, columns)
    position = _ranged(bins, place, columns, lambda each: _in_mm(each.position_mean_m))
    setpoint = _ranged(bins, place, columns, lambda each: _in_mm(each.setpoint_m))
    current = _ranged(bins, place, columns, lambda each: _pair(each.current_low_ma, each.current_high_ma))
    upper = _plot(((position, POSITION), (setpoint, SETPOINT)), width, height - current_rows, _LEAST_MM, "mm", plain)
    return upper + _plot(((current, CURRENT),), width, current_rows, _LEAST_MA, "mA", plain)


def _plot(
    series: Sequence[tuple[list[Range | None], str]],
    width: int,
    height: int,
    least: float,
    unit: str,
    plain: Mapping[str, str],
) -> list[Runs]:
    canvas = Canvas(width - LABEL_WIDTH, height)
    low, high = _limits([point for points, _ in series for point in points if point is not None], least)
    for points, pen in series:
        scaled = [None if p is None else ((p[0] - low) / (high - low), (p[1] - low) / (high - low)) for p in points]
        canvas.series(scaled, pen, dashed=pen == SETPOINT)
    digits = 0 if high - low > 20.0 else 1 if high - low > 2.0 else 2  # noqa: PLR2004 - a label has three digits or so
    labels = [f"{high:.{digits}f}", *[""] * (height - 2), f"{low:.{digits}f} {unit}"]
    return [
        [(f"{label:>{LABEL_WIDTH - 1}.{LABEL_WIDTH - 1}} ", FRAME), *row]
        for label, row in zip(labels, canvas.rows(plain), strict=True)
    ]


def _limits(points: Sequence[Range], least: float) -> Range:
    """Return the ends of an axis that holds all points, and is at least `least` long."""
    if not points:
        return 0.0, 1.0
    low, high = min(low for low, _ in points), max(high for _, high in points)
    margin = max((high - low) * _HEADROOM, (least - (high - low)) / 2.0)
    return low - margin, high + margin


def _columns(window_s: float, now_ns: int, columns: int) -> Callable[[int], int]:
    """Return the function from the number of a bin to its column; columns do not move within themselves."""
    per_column = max(window_s * _NS / BIN_NS / columns, 1e-9)
    newest = math.floor(now_ns // BIN_NS / per_column)
    return lambda number: columns - 1 - newest + math.floor(number / per_column)


def _ranged(
    bins: Sequence[Bin], place: Callable[[int], int], columns: int, of: Callable[[Bin], Range | None]
) -> list[Range | None]:
    points: list[Range | None] = [None] * columns
    for each in bins:
        x, value = place(each.number), of(each)
        if value is None or not 0 <= x < columns:
            continue
        before = points[x]
        points[x] = value if before is None else (min(before[0], value[0]), max(before[1], value[1]))
    return points


def _pair(low: float | None, high: float | None) -> Range | None:
    return None if low is None or high is None else (low, high)


def _in_mm(value_m: float | None) -> Range | None:
    return None if value_m is None else (value_m * _MM, value_m * _MM)
