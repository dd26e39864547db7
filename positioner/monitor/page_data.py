"""What the page gets: once its setup, then the newest state of a valve and the bins that are new to it. Pure."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from positioner.host.valve_view import SILENT_S
from positioner.monitor.trend import BIN_NS, KEPT_S
from positioner.monitor.view import MESSAGES
from positioner.pictures import colours

if TYPE_CHECKING:
    from positioner.monitor.kept_table import TableView
    from positioner.monitor.source import Source
    from positioner.monitor.trend import Bin

_NS = 1_000_000_000
_MM = 1e3


def setup_of(source: Source, valve: str) -> dict[str, Any]:
    """Return what the page needs once: the valves, which one it shows first, times and colours."""
    return {
        "valves": source.valves,
        "valve": valve,
        "bin_s": BIN_NS / _NS,
        "kept_s": KEPT_S,
        "silent_s": SILENT_S,
        "messages": MESSAGES,
        "is_log": source.progress is not None,
        "colours": {
            "position": colours.POSITION,
            "setpoint": colours.SETPOINT,
            "command": colours.COMMAND,
            "ink": colours.INK,
            "faint": colours.FAINT,
            "status": colours.STATUS,
        },
    }


class Stream:
    """The states for one browser, which has the bins that it was sent before."""

    def __init__(self, source: Source, valve: str) -> None:
        """Begin with all bins."""
        self._source, self._valve = source, valve
        self._since, self._before_ns = -1, 0

    def next(self) -> dict[str, Any]:
        """Return the newest state; `reset` where the bins of before do not count any more: a log went back."""
        source = self._source
        snapshot = source.snapshot(self._valve, self._since)
        is_reset = snapshot.now_ns < self._before_ns
        if is_reset:
            snapshot = source.snapshot(self._valve)
        self._before_ns = snapshot.now_ns
        if snapshot.bins:
            self._since = snapshot.bins[-1].number - 1  # the newest one may still change
        view, progress = snapshot.view, source.progress
        return {
            "view": asdict(view) | {"error_m": view.error_m},
            "bins": [_plain(each) for each in snapshot.bins],
            "bin": snapshot.now_ns // BIN_NS,
            "reset": is_reset,
            "table": _table(snapshot.table),
            "progress": None if progress is None else asdict(progress),
            "line": source.line,
            "in_trouble": source.in_trouble,
        }


def _plain(each: Bin) -> list[float | None]:
    """Return number, position and setpoint in mm, lowest and highest current in mA."""
    lengths = (each.position_mean_m, each.setpoint_m)
    in_mm = [None if value is None else round(value * _MM, 4) for value in lengths]
    return [each.number, *in_mm, each.current_low_ma, each.current_high_ma]


def _table(table: TableView | None) -> dict[str, Any] | None:
    if table is None:
        return None
    rows = [{"name": row.name, "counts": sorted(row.counts.items())} for row in table.rows]
    return {"samples": table.samples, "cells": table.cells, "cell_width_m": table.cell_width_m, "rows": rows}
