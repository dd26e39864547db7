"""What a replay leaves on the disk: `trace.csv`, and `replay.png`, the recorded beside the computed current. Shell."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from positioner.bench.panels import fit, line, name
from positioner.errors import StateError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from positioner.replay.other import Row

COLUMNS = (
    "time_s", "setpoint_m", "measured_m", "recorded_ma", "computed_ma", "recorded_mode", "computed_mode",
    "fallback", "reason",
)  # fmt: skip
_RECORDED, _COMPUTED, _SETPOINT, _MEASURED = "#0072B2", "#D55E00", "#009E73", "#8A8A8A"


def leave(folder: Path, rows: Sequence[Row], title: str) -> None:
    """Write both files into `folder`.

    Raises:
        StateError: the folder cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with (folder / "trace.csv").open("w", encoding="utf-8") as file:
            file.write(",".join(COLUMNS) + "\n")
            file.writelines(_text(row) for row in rows)
        if rows:
            _draw(folder / "replay.png", rows, title)
    except OSError as error:
        raise StateError(f"{error.filename or folder}: cannot be written: {error.strerror}") from error


def _text(row: Row) -> str:
    numbers = (row.setpoint_m, row.measured_m, row.recorded_ma, row.computed_ma)
    cells = ["" if number is None else f"{number:.8f}" for number in numbers]
    mode = "" if row.recorded_mode is None else str(int(row.recorded_mode))
    words = [text.replace(",", ";") for text in (row.fallback, row.reason)]
    return ",".join((f"{row.time_s:.6f}", *cells, mode, str(int(row.computed_mode)), *words)) + "\n"


def _draw(path: Path, rows: Sequence[Row], title: str) -> None:
    figure = Figure(figsize=(16, 9), dpi=100, facecolor="white")
    FigureCanvasAgg(figure)
    above, below = figure.subplots(2, 1, sharex=True)
    figure.subplots_adjust(left=0.065, right=0.872, top=0.93, bottom=0.07, hspace=0.09)
    time_s = np.array([row.time_s for row in rows])
    setpoint_mm = _column([row.setpoint_m for row in rows]) * 1e3
    measured_mm = _column([row.measured_m for row in rows]) * 1e3
    line(above, time_s, measured_mm, _MEASURED, width=0.8, zorder=2.0)
    line(above, time_s, setpoint_mm, _SETPOINT, width=1.4)
    _fit(above, [setpoint_mm, measured_mm], (1.0, 99.0))
    name(above, [("measured", _MEASURED), ("setpoint", _SETPOINT)])
    recorded_ma = _column([row.recorded_ma for row in rows])
    computed_ma = _column([row.computed_ma for row in rows])
    line(below, time_s, recorded_ma, _RECORDED, width=3.0, alpha=0.55, zorder=3.0)
    line(below, time_s, computed_ma, _COMPUTED, width=1.2)
    _fit(below, [recorded_ma, computed_ma], (0.0, 100.0))
    name(below, [("recorded", _RECORDED), ("computed", _COMPUTED)])
    for panel, label in ((above, "position, mm"), (below, "current, mA")):
        panel.spines[["top", "right"]].set_visible(False)
        panel.margins(x=0.0)
        panel.set_ylabel(label, fontsize=13)
    below.set_xlabel("time, s", fontsize=13)
    figure.suptitle(title, x=0.065, ha="left", fontsize=15, fontweight="bold")
    figure.savefig(path)


def _fit(panel: Axes, curves: Sequence[NDArray[np.float64]], percentiles: tuple[float, float]) -> None:
    known = [curve[np.isfinite(curve)] for curve in curves]
    if any(curve.size for curve in known):
        fit(panel, [curve for curve in known if curve.size], percentiles)


def _column(values: Sequence[float | None]) -> NDArray[np.float64]:
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)
