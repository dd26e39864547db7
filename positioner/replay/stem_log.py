"""Command and stem position in the log of one valve, reading by reading: what a diagnosis needs of it. Shell."""

from __future__ import annotations

import math
from array import array
from typing import TYPE_CHECKING

import numpy as np

from positioner.diagnostics.loop_table import LoopTable
from positioner.inputs.plain_file import MOST_MIB
from positioner.replay.log import LogError, LogFrame, read_log
from positioner.wire.formats import FrameRejectedError
from positioner.wire.messages import CurrentCommand, Quality, StemPosition

if TYPE_CHECKING:
    from pathlib import Path

    from positioner.config.schema import Configuration

CURRENT_AT_0_MA, CURRENT_AT_100_MA = 4.0, 20.0
_BYTES_PER_READING = 128
"""Memory that a diagnosis takes for a reading, all in all: 70 to 112 where it was measured."""
_KNOWN = 0.1
"""Of the configured slope of current over travel: how well it is known."""


class _Readings:
    """The readings so far in percent of span, each with the current in mA that acted on the stem before it."""

    def __init__(self, path: Path, configuration: Configuration, most_mib: int) -> None:
        self._path, self._most_mib = path, most_mib
        self._most = (most_mib << 20) // _BYTES_PER_READING
        self._codec = configuration.make_codec()
        self._wanted = {self._codec.identifier(kind) for kind in (StemPosition, CurrentCommand)}
        self._valve = configuration.valve
        self._sent: dict[int | None, float] = {}
        self._newest_ma = math.nan
        self.current_ma = array("d")
        self.percent = array("d")

    def add(self, logged: LogFrame) -> None:
        """Add the next frame of the log.

        Raises:
            LogError: a diagnosis would take more memory than is allowed.
        """
        if logged.frame.is_error or logged.frame.identifier not in self._wanted:
            return
        try:
            message, counter = self._codec.decode(logged.frame)
        except FrameRejectedError:
            return
        if isinstance(message, CurrentCommand):
            self._sent[counter] = self._newest_ma = message.current_ma
        elif isinstance(message, StemPosition) and message.quality in {Quality.VALID, Quality.SUSPECT}:
            acted_ma = self._sent.get(message.command_counter, self._newest_ma)
            if len(self.percent) >= self._most:
                text = f"holds more than {self._most} readings, whose diagnosis takes more than {self._most_mib} MiB"
                raise LogError(f"{self._path}: {text}: give a part of it, or allow more by --max-size")
            if not math.isnan(acted_ma):
                self.current_ma.append(acted_ma)
                self.percent.append(100.0 * (message.position_m - self._valve.travel_min_m) / self._valve.span_m)


def stem_table(path: Path, configuration: Configuration, most_mib: int = MOST_MIB) -> LoopTable:
    """Return current in mA and stem position in percent of the span, one row for each reading under a command.

    Raises:
        LogError: the log cannot be read, holds no position under a command of this valve, or takes too much memory.
    """
    readings = _Readings(path, configuration, most_mib)
    log = read_log(path, readings.add, most_mib)
    if not readings.percent:
        text = f"holds {log.count} frames, and no stem position under a command of {configuration.valve.id} among them"
        raise LogError(f"{path}: {text}: is it another valve's, or does [wire] describe other frames?")
    valve = configuration.valve
    slope = (
        valve.spring_rate_n_per_m * valve.span_m / (valve.force_gain_n_per_ma * (CURRENT_AT_100_MA - CURRENT_AT_0_MA))
    )
    return LoopTable(
        op=np.array(readings.current_ma),
        pv=None,
        sp=None,
        stem=np.array(readings.percent),
        period_s=configuration.control.sample_period_s,
        is_timed=True,
        names={},
        notes=(log.cut,) if log.cut else (),
        slope=slope,
        slope_sigma=_KNOWN * slope,
    )
