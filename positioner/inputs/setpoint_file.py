"""Setpoints over time in a CSV file: each row holds until the next one. Pure.

The header names the columns with their units: time_s, and setpoint_mm, setpoint_pct (of the span) or setpoint_m. Other
columns are left alone, and so are lines that begin with #. Every mistake of a file is found at once: a valve will move.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from positioner.errors import ConfigurationError, Problem
from positioner.inputs.csv_table import number_in
from positioner.inputs.durations import duration

if TYPE_CHECKING:
    from collections.abc import Callable

TIME = "time_s"
_FACTORS = {"setpoint_mm": 1e-3, "setpoint_pct": 1e-2, "setpoint_m": 1.0}
_HEADER = f"write the header {TIME},setpoint_mm (or setpoint_pct, setpoint_m)"
_DELIMITERS = (",", ";", "\t")
_SHOWN = 20
"""Mistakes of one file that are told."""
_LEAST = 2
_LATEST_S = 1e9
"""Instants up to here differ by less than a µs in a float: the spacing is 2⁻²³ s."""
_SHORTEST_S = 1e-3
"""No host sends setpoints so fast, and no count of rounds of a longer file leaves the range of a float."""


@dataclass(frozen=True, slots=True)
class SetpointRow:
    """One row: the instant in s from which its setpoint in m holds, and its line in the file."""

    line: int
    time_s: float
    setpoint_m: float


def setpoint_rows(
    source: str, text: str, span_m: float, refused: Callable[[float], str] = lambda _: ""
) -> tuple[SetpointRow, ...]:
    """Return the rows of a file, in their order; `refused` says why a setpoint in m cannot be reached, or nothing.

    Raises:
        ConfigurationError: a column is missing, or rows are wrong; it has every mistake with its line.
    """
    lines = [(number, line) for number, line in enumerate(text.splitlines(), 1) if line.strip()]
    lines = [(number, line) for number, line in lines if not line.lstrip().startswith("#")]
    if not lines:
        raise ConfigurationError(source, (Problem("file", None, f"is empty; {_HEADER}"),))
    (head_line, head), *body = lines
    delimiter = max(_DELIMITERS, key=head.count)
    names = [cell.strip().strip('"').lower() for cell in head.split(delimiter)]
    columns = _Columns.of(source, head_line, names, span_m)
    rows: list[SetpointRow] = []
    problems: list[Problem] = []
    for line, content in body:
        found = columns.row(line, content.split(delimiter), rows[-1].time_s if rows else -math.inf, refused)
        if isinstance(found, Problem):
            problems.append(found)
        else:
            rows.append(found)
    if len(problems) > _SHOWN:
        left = len(problems) - _SHOWN
        problems = [*problems[:_SHOWN], Problem("file", None, f"and {left} more mistakes")]
    if not problems and len(rows) < _LEAST:
        problems = [Problem("file", None, "holds fewer than two rows; give at least two instants")]
    if not problems and rows[-1].time_s - rows[0].time_s < _SHORTEST_S:
        problems = [Problem("file", None, f"lasts less than {duration(_SHORTEST_S)}: are the times in {TIME} seconds?")]
    if problems:
        raise ConfigurationError(source, tuple(problems))
    return tuple(rows)


@dataclass(frozen=True, slots=True)
class _Columns:
    """Where time and setpoint stand, what the setpoint is called, and the factor that makes m of it."""

    count: int
    time: int
    setpoint: int
    name: str
    factor: float

    @classmethod
    def of(cls, source: str, line: int, names: list[str], span_m: float) -> _Columns:
        """Return the columns that a header names.

        Raises:
            ConfigurationError: one is missing or stands twice.
        """
        given = [name for name in _FACTORS if name in names]
        if TIME not in names:
            raise ConfigurationError(source, (Problem("header", line, f"has no column {TIME}; {_HEADER}"),))
        if not given:
            message = f"has no column with setpoints and their unit; {_HEADER}"
            raise ConfigurationError(source, (Problem("header", line, message),))
        twice = [name for name in (TIME, *given) if names.count(name) > 1]
        if len(given) > 1 or twice:
            message = f"has {' and '.join([*given, *twice])}: one column of setpoints and one of times are needed"
            raise ConfigurationError(source, (Problem("header", line, message),))
        factor = _FACTORS[given[0]] * (span_m if given[0] == "setpoint_pct" else 1.0)
        return cls(len(names), names.index(TIME), names.index(given[0]), given[0], factor)

    def row(
        self, line: int, cells: list[str], after_s: float, refused: Callable[[float], str]
    ) -> SetpointRow | Problem:
        """Return the row, or what is wrong with it."""
        if len(cells) != self.count:
            return Problem("row", line, f"has {len(cells)} cells, and the header has {self.count}")
        time_s, value = number_in(cells[self.time]), number_in(cells[self.setpoint])
        setpoint_m, given = value * self.factor, cells[self.setpoint].strip()
        if math.isnan(time_s) or cells[self.time].strip().endswith("%"):
            return Problem(TIME, line, f"{cells[self.time].strip()!r} is no number")
        why = f"must be later than {after_s:g} of the row before; sort the rows" if time_s <= after_s else ""
        if abs(time_s) > _LATEST_S:
            why = f"must be within {_LATEST_S:.0f} s, which is 31 years; count from the begin of the file"
        if why:
            return Problem(f"{TIME} = {time_s:g}", line, why)
        if math.isnan(value):
            why = "is no number"
        elif given.endswith("%") and not self.name.endswith("pct"):
            why = "percent stand in a column setpoint_pct"
        else:
            why = refused(setpoint_m)
        return Problem(f"{self.name} = {given}", line, why) if why else SetpointRow(line, time_s, setpoint_m)
