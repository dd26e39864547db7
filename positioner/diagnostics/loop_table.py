"""A control loop from a table: which column is what, the period, and what is mended or left out. Pure."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from datetime import datetime
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from positioner.errors import RecordError, UsageError
from positioner.inputs.csv_table import number_in
from positioner.inputs.nearest import nearest

if TYPE_CHECKING:
    from positioner.inputs.csv_table import Column, CsvTable

Array = NDArray[np.float64]

_ROLES = {
    "op": (
        "op",
        "out",
        "output",
        "co",
        "controlleroutput",
        "opvalue",
        "current_ma",
        "command",
        "u",
        "stellgröße",
        "stellwert",
    ),
    "pv": ("pv", "process", "processvalue", "processvariable", "measurement", "meas", "y", "istwert"),
    "sp": ("sp", "setpoint", "set", "wsp", "ref", "reference", "r", "sollwert"),
    "time": ("time", "timestamp", "datetime", "date", "t", "time_s", "seconds", "zeit"),
    "stem": ("measured_m", "stem", "travel", "position", "pos", "valveposition", "vp", "zt", "mv"),
}
"""Names of columns by what they mean; where OP has no other name, MV (manipulated variable) is OP."""
OPTIONS = {"op": "--op", "pv": "--pv", "sp": "--sp", "time": "--time", "stem": "--stem"}
_DATES = (
    "%d.%m.%Y %H:%M:%S", "%d.%m.%Y %H:%M:%S.%f", "%d.%m.%Y %H:%M", "%m/%d/%Y %H:%M:%S", "%m/%d/%Y %H:%M",
    "%m/%d/%Y %I:%M:%S %p",    "%d-%b-%y %H:%M:%S", "%d-%b-%Y %H:%M:%S", "%H:%M:%S", "%H:%M:%S.%f",
)  # fmt: skip
_MOST_MISSING = 0.2
_LONGEST_MENDED = 5
"""Samples of the longest gap that is filled by a straight line."""
_IRREGULAR = 0.1


@dataclass(frozen=True, slots=True)
class LoopTable:
    """The signals of a loop at equal distances of period_s, each None where there is no such column.

    names: of the columns by what they mean; is_timed: whether the period comes from time stamps or the user; notes:
    what was mended or left out, a line each.
    slope, slope_sigma: percent of command for a percent of travel, and how well it is known; None where it is not.
    Where it is known, the log also says which command acted on which reading.
    """

    op: Array
    pv: Array | None
    sp: Array | None
    stem: Array | None
    period_s: float
    is_timed: bool
    names: dict[str, str]
    notes: tuple[str, ...]
    slope: float | None = None
    slope_sigma: float = 0.0


def loop_of(table: CsvTable, wanted: dict[str, str | None], period_s: float | None) -> LoopTable:
    """Return the loop in a table; `wanted` names columns by what they mean, None where the name tells.

    Raises:
        UsageError: a named column is not there, or OP, or PV and stem position, are not to be found.
        RecordError: too few numbers are in a column.
    """
    names = _names(table, wanted)
    columns = {column.name: column for column in table.columns}
    notes: list[str] = []
    if table.uneven:
        notes.append(
            f"{len(table.uneven)} lines with another number of cells are left out, first line {table.uneven[0]}"
        )
    signals = {role: _numbers(table, columns[name], notes) for role, name in names.items() if role != "time"}
    time, is_timed = None, period_s is not None
    if period_s is None and "time" in names:
        time = _times(columns[names["time"]])
        if time is None:
            notes.append(f"column {names['time']!r} holds no times that can be read: periods are in samples")
        is_timed = time is not None
    if time is not None:
        period_s, time, signals = _in_order(table, time, signals, notes)
        signals = _regular(time, period_s, signals, notes)
    period_s = period_s or 1.0
    signals = _without_gaps(signals, notes)
    pv, sp, stem = (signals.get(role) for role in ("pv", "sp", "stem"))
    return LoopTable(signals["op"], pv, sp, stem, period_s, is_timed, names, tuple(notes))


def _names(table: CsvTable, wanted: dict[str, str | None]) -> dict[str, str]:
    """Return the name of the column for each meaning."""
    found: dict[str, str] = {}
    for role, name in wanted.items():
        if name is None:
            continue
        if name not in table.names:
            raise UsageError(f"{table.source}: has no column {name!r} ({OPTIONS[role]}); {nearest(name, table.names)}")
        found[role] = name
    for role in _ROLES:
        if role not in found and (name := _fitting(table, role, set(found.values()))):
            found[role] = name
    if "op" not in found and "stem" in found and wanted["stem"] is None and "mv" in _words(found["stem"]):
        found["op"] = found.pop("stem")
    for role in ("op", "pv"):
        if role not in found and not (role == "pv" and "stem" in found):
            listed = ", ".join(table.names)
            text = f"which column is {role.upper()}? Say it with {OPTIONS[role]}; columns: {listed}"
            raise UsageError(f"{table.source}: {text}")
    return found


def _fitting(table: CsvTable, role: str, taken: set[str]) -> str | None:
    """Return the column whose name says that it has this meaning, None where there is none.

    Raises:
        UsageError: there are several.
    """
    for word in _ROLES[role]:
        fits = [name for name in table.names if name not in taken and word in _words(name)]
        if len(fits) > 1:
            listed = ", ".join(map(repr, fits))
            raise UsageError(f"{table.source}: {listed} may all be {role.upper()}: say which one with {OPTIONS[role]}")
        if fits:
            return fits[0]
    return None


def _words(name: str) -> set[str]:
    """Return the words of a column's name, without units in brackets; the whole of it is one, too."""
    bare = re.sub(r"[\[(].*?[\])]", "", name).strip().lower()
    return {bare, re.sub(r"[^a-z0-9]", "", bare), *re.split(r"[^a-z0-9]+", bare)} - {""}


def _numbers(table: CsvTable, column: Column, notes: list[str]) -> Array:
    values = np.array([number_in(cell) for cell in column.cells])
    bad = np.flatnonzero(np.isnan(values))
    if bad.size:
        first = int(bad[0])
        shown = column.cells[first] or "empty"
        where = f"first in line {table.lines[first]} ({shown})"
        text = f"column {column.name!r}: {bad.size} of {values.size} cells hold no number, {where}"
        if bad.size > _MOST_MISSING * values.size:
            raise RecordError(f"{table.source}: {text}: too many; choose another column, or mend the file")
        notes.append(text)
    return values


def _times(column: Column) -> Array | None:
    """Return the times in s, from numbers or dates; None where they are neither."""
    numbers = np.array([number_in(cell) for cell in column.cells])
    if np.mean(np.isnan(numbers)) <= _MOST_MISSING:
        return numbers
    for form in (None, *_DATES):
        try:
            first = _instant(column.cells[0], form)
        except ValueError:
            continue
        found = []
        for cell in column.cells:
            try:
                found.append((_instant(cell, form) - first).total_seconds())
            except (ValueError, TypeError):
                found.append(math.nan)
        if np.mean(np.isnan(found)) <= _MOST_MISSING:
            return np.array(found)
    return None


def _instant(cell: str, form: str | None) -> datetime:
    return datetime.fromisoformat(cell) if form is None else datetime.strptime(cell, form)  # noqa: DTZ007 - of a file


def _in_order(
    table: CsvTable, time: Array, signals: dict[str, Array], notes: list[str]
) -> tuple[float, Array, dict[str, Array]]:
    """Return the period, and the rows whose times grow."""
    good = ~np.isnan(time)
    rises = np.zeros(time.size, dtype=np.bool_)
    latest = -math.inf
    for number in np.flatnonzero(good):
        if time[number] > latest:
            rises[number], latest = True, float(time[number])
    if not np.all(rises):
        notes.append(f"{int(np.sum(~rises))} rows are left out: their time is missing, or does not grow")
    time = time[rises]
    if time.size < 2:  # noqa: PLR2004
        text = "fewer than two rows have a time that grows: name the right column with --time"
        raise RecordError(f"{table.source}: {text}")
    return float(np.median(np.diff(time))), time, {role: values[rises] for role, values in signals.items()}


def _regular(time: Array, period_s: float, signals: dict[str, Array], notes: list[str]) -> dict[str, Array]:
    """Return the signals at equal distances; between two rows a straight line, if they are not too far apart."""
    steps = np.diff(time) / period_s
    if float(np.max(np.abs(steps - 1.0))) <= _IRREGULAR:
        return signals
    regular = time[0] + period_s * np.arange(int((time[-1] - time[0]) / period_s + 1e-6) + 1)
    far = np.zeros(regular.size, dtype=np.bool_)
    for number in np.flatnonzero(steps > _LONGEST_MENDED + 1.0):
        far |= (regular > time[number]) & (regular < time[number + 1])
    notes.append(f"times are not at equal distances: put on a period of {period_s:.6g} s")
    found = {}
    for role, values in signals.items():
        known = ~np.isnan(values)
        found[role] = np.where(far, np.nan, np.interp(regular, time[known], values[known]))
    return found


def _without_gaps(signals: dict[str, Array], notes: list[str]) -> dict[str, Array]:
    """Return the longest stretch without a long gap; short gaps are filled by a straight line."""
    missing = np.any([np.isnan(values) for values in signals.values()], axis=0)
    if not np.any(missing):
        return signals
    edges = np.flatnonzero(np.diff(np.concatenate([[0], missing.astype(np.int64), [0]])))
    long = [(int(b), int(e)) for b, e in zip(edges[::2], edges[1::2], strict=True) if e - b > _LONGEST_MENDED]
    borders = [(0, 0), *long, (missing.size, missing.size)]
    stretches = [(before[1], after[0]) for before, after in pairwise(borders)]
    begin, end = max(stretches, key=lambda each: each[1] - each[0])
    if long:
        text = f"{len(long)} gaps of more than {_LONGEST_MENDED} samples"
        notes.append(f"{text}: of {missing.size} samples the longest stretch without one is used, {end - begin}")
    found = {}
    for role, values in signals.items():
        part = values[begin:end]
        known = np.flatnonzero(~np.isnan(part))
        found[role] = np.interp(np.arange(part.size), known, part[known]) if known.size else part
    return found
