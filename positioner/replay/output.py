"""The files of a replay: `trace.csv`, and `replay.png` and `.svg` with the recorded and the computed current. Shell."""

from __future__ import annotations

from typing import TYPE_CHECKING, Self

from positioner.bench.mode_bands import bands_of
from positioner.bench.modes import ModeSpan
from positioner.errors import writing
from positioner.pictures.bands import draw_bands
from positioner.pictures.colours import COMMAND, INK, MEASURED, REFERENCE, SETPOINT
from positioner.pictures.files import save
from positioner.pictures.panels import HEAD, LABEL, LINE, dress, fit, head, line, name, new_figure
from positioner.replay.envelope import Envelope
from positioner.values import replace
from positioner.wire.messages import Cause, Mode

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

    from positioner.pictures.bands import Band
    from positioner.replay.other import Row

COLUMNS = (
    "time_s", "setpoint_m", "measured_m", "recorded_ma", "computed_ma", "recorded_mode", "computed_mode",
    "fallback", "reason",
)  # fmt: skip
_MOST_SPANS = 1000
_CURVES = ("setpoint_m", "measured_m", "recorded_ma", "computed_ma")


class OutputFolder:
    """The folder with both files: a context in which `trace.csv` is written row by row."""

    def __init__(self, folder: Path) -> None:
        """Begin `trace.csv` in `folder`.

        Raises:
            StateError: the folder cannot be written.
        """
        self._folder = folder
        self._envelope = Envelope(len(_CURVES))
        self._spans: list[ModeSpan] = []
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
        self._follow_mode(row)

    def _follow_mode(self, row: Row) -> None:
        """Lengthen the span of the computed mode, or begin the next one; of too many only the first are kept."""
        cause = Cause.NONE if row.computed_mode is Mode.ACTIVE else row.cause
        if self._spans:
            last = self._spans[-1]
            self._spans[-1] = replace(last, end_s=row.time_s)
            if (last.mode, last.cause) == (row.computed_mode, cause) or len(self._spans) == _MOST_SPANS:
                return
        self._spans.append(ModeSpan(row.computed_mode, cause, row.time_s, row.time_s))

    def draw(self, title: str) -> None:
        """Write `replay.png`, if there is a row.

        Raises:
            StateError: the folder cannot be written.
        """
        if self._spans:
            with writing(self._folder):
                _draw(self._folder / "replay.png", *self._envelope.lines(), title, bands_of(self._spans))


def _text(row: Row) -> str:
    numbers = (row.setpoint_m, row.measured_m, row.recorded_ma, row.computed_ma)
    cells = ["" if number is None else f"{number:.8f}" for number in numbers]
    mode = "" if row.recorded_mode is None else str(int(row.recorded_mode))
    words = [text.replace(",", ";") for text in (row.fallback, row.reason)]
    return ",".join((f"{row.time_s:.6f}", *cells, mode, str(int(row.computed_mode)), *words)) + "\n"


def _draw(path: Path, time_s: NDArray[np.float64], values: NDArray[np.float64], title: str, bands: list[Band]) -> None:
    figure = new_figure(7.5)
    panels = above, below = figure.subplots(2, 1, sharex=True)
    figure.subplots_adjust(left=0.065, right=0.875, top=0.91, bottom=0.08, hspace=0.09)
    setpoint_m, measured_m, recorded_ma, computed_ma = values.T
    setpoint_mm, measured_mm = setpoint_m * 1e3, measured_m * 1e3
    line(above, time_s, measured_mm, MEASURED, width=0.9, zorder=2.0)
    line(above, time_s, setpoint_mm, SETPOINT, width=1.2)
    fit(above, [setpoint_mm, measured_mm], (1.0, 99.0))
    name(above, [(LINE, MEASURED, "measured"), (LINE, SETPOINT, "setpoint")])
    line(below, time_s, recorded_ma, REFERENCE, width=3.4, zorder=3.0)
    line(below, time_s, computed_ma, COMMAND, width=1.1)
    fit(below, [recorded_ma, computed_ma], (0.0, 100.0))
    name(below, [(LINE, REFERENCE, "recorded"), (LINE, COMMAND, "computed")])
    for panel, label in ((above, "position, mm"), (below, "current, mA")):
        dress(panel)
        panel.margins(x=0.0)
        panel.set_ylabel(label, fontsize=LABEL)
    draw_bands(panels, bands, float(time_s[0]), float(time_s[-1]))
    below.set_xlabel("time, s", fontsize=LABEL)
    head(figure, 0.065, ((title, HEAD, "bold", INK),))
    save(figure, path)
