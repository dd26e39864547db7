"""`load_log` and `diagnose`: a recorded bus as arrays, and what a record says about its valve. Shell: reads files."""

from __future__ import annotations

import math
import warnings
from array import array
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from positioner.api.simulation import Simulation
from positioner.config.reader import load_config
from positioner.diagnostics.finding import Finding, finding_of
from positioner.diagnostics.loop_table import OPTIONS, LoopTable, loop_of
from positioner.inputs.csv_table import table_in
from positioner.inputs.plain_file import MOST_MIB
from positioner.replay.log import LogError, LogFrame, read_log
from positioner.replay.stem_log import CURRENT_AT_0_MA, CURRENT_AT_100_MA, stem_table
from positioner.wire.codec import make_codec
from positioner.wire.formats import FrameRejectedError
from positioner.wire.messages import CurrentCommand, Setpoint, StemPosition

if TYPE_CHECKING:
    from os import PathLike

Array = NDArray[np.float64]

_COLUMNS = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class Log:
    """The frames of one valve in a log, a row for each position frame; arrays have shape (n,).

    Attributes:
        time_s: since the first frame of the log.
        position_m: the reading.
        setpoint_m: that of the last frame before it, NaN before the first one.
        current_ma: that of the last frame before it, NaN before the first one.
        mode: in which the positioner was, -1 before its first command.
        frames: how many frames the log has.
        rejected: how many frames of this valve cannot be decoded (damaged ones).
    """

    time_s: Array
    position_m: Array
    setpoint_m: Array
    current_ma: Array
    mode: NDArray[np.int64]
    frames: int
    rejected: int


def load_log(
    path: str | PathLike[str],
    config: str | PathLike[str] | None = None,
    valve: str | None = None,
    *,
    complete: bool | None = None,
    max_size_mib: int = MOST_MIB,
) -> Log:
    """Return a recorded bus (candump, ASC, BLF, CSV, …) as arrays.

    The rows before the first setpoint and the first command have NaN there, and so has a maximum over them. A warning
    tells how many there are, unless `complete` says what becomes of them.

    Args:
        path: the log.
        config: the configuration of the valve, where the bus has other frames or identifiers than ours.
        valve: which valve is meant, where the configuration has several.
        complete: True leaves out the rows before the first setpoint and the first command, False keeps them.
        max_size_mib: memory that reading the log may take, in MiB.

    Raises:
        PositionerError: the log or the configuration cannot be read, or the log has no position frame of the valve, or
            with `complete` none after a setpoint and a command.
    """
    codec = make_codec() if config is None else load_config(Path(config), valve=valve).make_codec()
    wanted = {codec.identifier(kind) for kind in (StemPosition, CurrentCommand, Setpoint)}
    rows = array("d")
    setpoint_m = current_ma = math.nan
    mode, rejected = -1, 0

    def add(logged: LogFrame) -> None:
        nonlocal setpoint_m, current_ma, mode, rejected
        if logged.frame.is_error or logged.frame.identifier not in wanted:
            return
        try:
            message, _ = codec.decode(logged.frame)
        except FrameRejectedError:
            rejected += 1
            return
        if isinstance(message, Setpoint):
            setpoint_m = message.setpoint_m
        elif isinstance(message, CurrentCommand):
            current_ma, mode = message.current_ma, int(message.mode)
        elif isinstance(message, StemPosition):
            rows.extend((logged.time_ns / 1e9, message.position_m, setpoint_m, current_ma, mode))

    log = read_log(Path(path), add, max_size_mib)
    if not rows:
        raise LogError(f"{path}: holds {log.count} frames, and no stem position among them: is `config` missing?")
    columns = np.frombuffer(rows).reshape(-1, _COLUMNS)
    known = np.flatnonzero(~np.isnan(columns).any(axis=1))
    unknown = int(known[0]) if known.size else len(columns)
    if complete and unknown == len(columns):
        raise LogError(f"{path}: holds no stem position after both a setpoint and a command")
    if unknown and complete is None:
        text = f"{path}: {unknown} of {len(columns)} rows, from the first on, have no setpoint or no current yet: NaN"
        warnings.warn(f"{text}; complete=True leaves them out, complete=False keeps them", stacklevel=2)
    columns = columns[unknown if complete else 0 :].T.copy()
    return Log(
        time_s=columns[0],
        position_m=columns[1],
        setpoint_m=columns[2],
        current_ma=columns[3],
        mode=columns[4].astype(np.int64),
        frames=log.count,
        rejected=rejected,
    )


def diagnose(
    record: str | PathLike[str] | Simulation,
    config: str | PathLike[str] | None = None,
    *,
    valve: str | None = None,
    period_s: float | None = None,
    op_range: tuple[float, float] = (0.0, 100.0),
    max_size_mib: int = MOST_MIB,
    **columns: str,
) -> Finding:
    """Return whether a valve sticks, as `positioner diagnose` tells it: `verdict`, `reason`, `stick`, `jump`.

    Args:
        record: a CSV file of any loop; with `config` the log of a bus; or a `Simulation`, by its readings.
        config: the configuration of the valve.
        valve: which valve is meant, where the configuration has several.
        period_s: sample period of a CSV file without time stamps.
        op_range: OP at 0 and at 100 %, of a CSV file.
        max_size_mib: memory that the record may take, in MiB.
        **columns: names of its columns: op, pv, sp, time, stem.

    Raises:
        PositionerError: the record cannot be read, a column is not there, or it holds too little.
    """
    if isinstance(record, Simulation):
        return finding_of("simulation", _of_run(record), CURRENT_AT_0_MA, CURRENT_AT_100_MA)
    path = Path(record)
    if config is not None:
        table = stem_table(path, load_config(Path(config), valve=valve), max_size_mib)
        return finding_of(str(path), table, CURRENT_AT_0_MA, CURRENT_AT_100_MA)
    csv = table_in(path, ", or a bus log with its configuration", max_size_mib)
    loop = loop_of(csv, {role: columns.get(role) for role in OPTIONS}, period_s)
    return finding_of(str(path), loop, *op_range)


def _of_run(run: Simulation) -> LoopTable:
    """Return command and reading in percent of span; a reading belongs to the command before it."""
    return LoopTable(
        op=run.current_ma[:-1],
        pv=None,
        sp=None,
        stem=100.0 * run.measured_m[1:] / run.span_m,
        period_s=float(run.time_s[1] - run.time_s[0]),
        is_timed=True,
        names={},
        notes=(),
    )
