"""The loop current over time: a ramp, a step, a triangle, or the currents of a CSV file. Shell: reads files."""

from __future__ import annotations

import csv
import math
from bisect import bisect_right
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

from positioner.errors import ConfigurationError, Problem

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

HIGHEST_CURRENT_MA = 25.0
_COLUMNS = ("time_s", "current_ma")
_STEP_AFTER = 0.1
"""Of the duration: the instant of the step."""


_ROUNDING = 1e-9
"""Of an instant or a part: a sample this little before an edge counts as after it, whatever the rounding."""


class Shape(StrEnum):
    """The waveforms that need no file."""

    RAMP = "ramp"
    STEP = "step"
    TRIANGLE = "triangle"


@dataclass(frozen=True, slots=True)
class Waveform:
    """`current_ma(time_s)` is the loop current, for times from 0 to duration_s."""

    duration_s: float
    current_ma: Callable[[float], float]


def shaped(shape: Shape, low_ma: float, high_ma: float, duration_s: float) -> Waveform:
    """Return one `shape` from `low_ma` to `high_ma` (a triangle: and back) that lasts `duration_s`."""

    def current_ma(time_s: float) -> float:
        part = time_s / duration_s
        if shape is Shape.STEP:
            part = float(part >= _STEP_AFTER - _ROUNDING)
        elif shape is Shape.TRIANGLE:
            part = 1.0 - abs(1.0 - 2.0 * part)
        return low_ma + (high_ma - low_ma) * part

    return Waveform(duration_s, current_ma)


def from_file(path: Path) -> Waveform:
    """Return the waveform in the columns time_s and current_ma of a CSV file; each row holds until the next.

    Raises:
        ConfigurationError: the file cannot be read, a column is missing, or a row holds no numbers, or is out of
            range or out of order; the message names the first bad row.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = list(_rows(file, str(path)))
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "is not UTF-8 text"
        raise ConfigurationError(str(path), (Problem("file", None, f"cannot be read: {reason}"),)) from error
    if len(rows) < 2:  # noqa: PLR2004 - a duration needs two instants
        problem = Problem("file", None, "holds fewer than two rows; give at least a start and an end")
        raise ConfigurationError(str(path), (problem,))
    times, currents = zip(*rows, strict=True)
    return Waveform(times[-1], lambda time_s: currents[max(bisect_right(times, time_s + _ROUNDING) - 1, 0)])


def _rows(lines: Iterator[str], source: str) -> Iterator[tuple[float, float]]:
    reader = csv.DictReader(lines)
    missing = [column for column in _COLUMNS if column not in (reader.fieldnames or ())]
    if missing:
        message = f"has no column {missing[0]}; write the header time_s,current_ma"
        raise ConfigurationError(source, (Problem("header", 1, message),))
    before_s = -math.inf
    for row in reader:
        time_s, current_ma = (_number(row[column], column, source, reader.line_num) for column in _COLUMNS)
        if not 0.0 <= current_ma <= HIGHEST_CURRENT_MA:
            message = f"must be from 0 to {HIGHEST_CURRENT_MA:g} mA"
            raise _bad_row(source, reader.line_num, f"current_ma = {current_ma:g}", message)
        if time_s <= before_s or time_s < 0.0:
            message = "must be 0 or more, and later than the row before; sort the rows"
            raise _bad_row(source, reader.line_num, f"time_s = {time_s:g}", message)
        before_s = time_s
        yield time_s, current_ma


def _number(text: str | None, column: str, source: str, line: int) -> float:
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise _bad_row(source, line, f"{column} = {text or ''!r}", "is not a number; write it like 12.5")
    return value


def _bad_row(source: str, line: int, where: str, message: str) -> ConfigurationError:
    return ConfigurationError(source, (Problem(where, line, message),))
