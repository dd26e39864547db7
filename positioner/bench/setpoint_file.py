"""Setpoints in a CSV file: time and setpoint in each row, which holds until the next one. Shell: reads files."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING

from positioner.errors import ConfigurationError, Problem
from positioner.inputs.csv_table import text_of
from positioner.inputs.setpoint_file import setpoint_rows

if TYPE_CHECKING:
    from pathlib import Path

_MOST = 100_000
_SHORTEST_DWELL_S = 0.1
_MOST_DWELLS = 1000
_ROUNDING = 1e-9


def read_setpoints(path: Path, span_mm: float, period_s: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the setpoint in mm in each `period_s`, and the instants in s between which figures are computed.

    The last row holds as long as the one before it. Where every setpoint is held for 0.1 s, the figures are those of
    each one; else they are of the whole profile.

    Raises:
        ConfigurationError: the file cannot be read, a column is missing, or a row is wrong; the message has its line.
        RecordError: it is no text.
    """
    source = str(path)
    try:
        text = text_of(source, path.read_bytes())
    except OSError as error:
        raise ConfigurationError(source, (Problem("file", None, f"cannot be read: {error.strerror}"),)) from error
    found = setpoint_rows(source, text, span_mm * 1e-3)
    rows = [(row.time_s, round(row.setpoint_m * 1e3, 6)) for row in found]
    begin_s = rows[0][0]
    end_s = 2.0 * rows[-1][0] - rows[-2][0]
    count = math.floor((end_s - begin_s) / period_s + _ROUNDING)
    if not 0 < count <= _MOST:
        message = f"lasts {end_s - begin_s:g} s; a setpoint comes every {period_s:g} s, and at most {_MOST} are played"
        raise ConfigurationError(source, (Problem("time_s", None, message),))
    setpoints: list[float] = []
    row = 0
    for number in range(count):
        time_s = begin_s + number * period_s
        while row + 1 < len(rows) and rows[row + 1][0] <= time_s + _ROUNDING:
            row += 1
        setpoints.append(rows[row][1])
    changes = [number for number in range(1, count) if setpoints[number] != setpoints[number - 1]]
    edges = [0, *changes, count]
    shortest = min(after - before for before, after in pairwise(edges)) * period_s
    if shortest < _SHORTEST_DWELL_S or len(edges) > _MOST_DWELLS:
        edges = [0, count]
    return tuple(setpoints), tuple(number * period_s for number in edges)
