"""The files of a replay: `trace.csv`, and `replay.png` with the recorded and the computed current. Shell."""

from __future__ import annotations

from typing import TYPE_CHECKING, Self

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from positioner.bench.panels import fit, line, name
from positioner.errors import writing
from positioner.replay.envelope import Envelope

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
_CURVES = ("setpoint_m", "measured_m", "recorded_ma", "computed_ma")
_RECORDED, _COMPUTED, _SETPOINT, _MEASURED = "#0072B2", "#D55E00", "#009E73", "#8A8A8A"


class OutputFolder:
    """The folder with both files: a context in which `trace.csv` is written row by row."""

    def __init__(self, folder: Path) -> None:
        """Begin `trace.csv` in `folder`.

        Raises:
            StateError: the folder cannot be written.
        """
        self._folder = folder
        self._envelope = Envelope(len(_CURVES))
        self._is_empty = True
        with writing(self._folder):
            folder.mkdir(parents=True, exist_ok=True)
            self._trace = (folder / "trace.csv").open("w", encoding="utf-8")
            self._trace.write(",".join(COLUMNS) + "\n")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        with writing(self._folder):
            self._trace.close()

    def add(self, row: Row) -> None:
        """Append one row.

        Raises:
            StateError: the folder cannot be written.
        """
        with writing(self._folder):
            self._trace.write(_text(row))
        self._envelope.append(row.time_s, [getattr(row, name) for name in _CURVES])
        self._is_empty = False

    def draw(self, title: str) -> None:
        """Write `replay.png`, if there is a row.

        Raises:
            StateError: the folder cannot be written.
        """
        if not self._is_empty:
            with writing(self._folder):
                _draw(self._folder / "replay.png", *self._envelope.lines(), title)


def _text(row: Row) -> str:
    numbers = (row.setpoint_m, row.measured_m, row.recorded_ma, row.computed_ma)
    cells = ["" if number is None else f"{number:.8f}" for number in numbers]
    mode = "" if row.recorded_mode is None else str(int(row.recorded_mode))
    words = [text.replace(",", ";") for text in (row.fallback, row.reason)]
    return ",".join((f"{row.time_s:.6f}", *cells, mode, str(int(row.computed_mode)), *words)) + "\n"


def _draw(path: Path, time_s: NDArray[np.float64], values: NDArray[np.float64], title: str) -> None:
    figure = Figure(figsize=(16, 9), dpi=100, facecolor="white")
    FigureCanvasAgg(figure)
    above, below = figure.subplots(2, 1, sharex=True)
    figure.subplots_adjust(left=0.065, right=0.872, top=0.93, bottom=0.07, hspace=0.09)
    setpoint_m, measured_m, recorded_ma, computed_ma = values.T
    setpoint_mm, measured_mm = setpoint_m * 1e3, measured_m * 1e3
    line(above, time_s, measured_mm, _MEASURED, width=0.8, zorder=2.0)
    line(above, time_s, setpoint_mm, _SETPOINT, width=1.4)
    _fit(above, [setpoint_mm, measured_mm], (1.0, 99.0))
    name(above, [("measured", _MEASURED), ("setpoint", _SETPOINT)])
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
