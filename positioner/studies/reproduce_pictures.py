"""The pictures of `positioner reproduce`: the paper's figures 4 to 8, and all of them on one page. Pure drawing.

A figure shows the paper's three panels in each interpretation: position and setpoint, current with its bounds, speed
with its bounds. The page shows the positions alone, so that it fits a screen.
"""

from __future__ import annotations

from textwrap import wrap
from typing import TYPE_CHECKING

from matplotlib.lines import Line2D

from positioner.pictures.colours import BOUND, COMMAND, INK, MEASURED, POSITION, SETPOINT, STATUS
from positioner.pictures.panels import HEAD, LABEL, NORMAL, SMALL, dress, head, line, new_figure
from positioner.studies.interpretations import Interpretation, NoiseKind, Units
from positioner.studies.published_results import summary
from positioner.studies.reproduce import SIMULATIONS, WITH_TABLE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from positioner.studies.published_results import Assessment
    from positioner.studies.reproduce import PlayedRun

FIGURE_OF = {simulation: simulation + 3 for simulation in SIMULATIONS}
"""The paper's figure of a simulation."""

TITLES = {
    1: "no friction, no table",
    2: "friction, no table",
    3: "stiction table from half time",
    4: "spring 10 % softer",
    5: "10 % more friction",
}

NOISES = {
    NoiseKind.FILTERED: "white noise, Kalman filter",
    NoiseKind.RAW: "noise held 10 ms, raw differences",
    NoiseKind.FREE: "no noise",
}

UNITS = {Units.SI: "α 5 m/s, β 150 1/m", Units.CENTIMETRES: "α 5 cm/s, β 150 1/cm"}

_WORDS = {True: "yes", False: "no", None: "not decided"}
_COLOURS = {True: STATUS["good"], False: STATUS["failure"], None: STATUS["unknown"]}
_LIMITS = ((60.0, 95.0), (3.0, 21.0), (-2.3, 2.3))
_TICKS = ((60, 70, 80, 90), (4, 8, 12, 16, 20), (-2, -1, 0, 1, 2))
_QUANTITIES = ("position, mm", "current, mA", "speed, m/s")
_POSITION, _SETPOINT, _TABLE = "true position", "setpoint", "use of the table begins"
_SIGNS = (
    (Line2D([], [], color=POSITION, linewidth=2.0), "true position and speed"),
    (Line2D([], [], color=SETPOINT, linewidth=1.2), _SETPOINT),
    (Line2D([], [], color=COMMAND, linewidth=1.6), "command"),
    (Line2D([], [], color=BOUND, linewidth=2.6, alpha=0.6), "bound, where active"),
    (Line2D([], [], color=MEASURED, linewidth=1.0, linestyle=(0, (4, 3))), _TABLE),
)
_LINE_PT, _LINE_IN = 12.5, 12.5 / 72.0
_LETTERS = 56
"""Letters of a line above a column, in usual weight."""
_COLUMNS = 3
_LEFT, _RIGHT = 0.06, 0.985


def interpretation_title(interpretation: Interpretation, *, table: bool = True) -> str:
    """Return the interpretation in words; without a `table` α and β have no effect."""
    noise = NOISES[interpretation.noise]
    label = noise if interpretation.noise is NoiseKind.FREE else f"{interpretation.noise}: {noise}"
    return f"{label}, {UNITS[interpretation.units]}" if table else label


def simulation_figure(simulation: int, played_runs: Sequence[PlayedRun], assessments: Sequence[Assessment]) -> Figure:
    """Return the paper's figure of `simulation`: a column for each interpretation, with its assessments."""
    shown = [played for played in played_runs if played.run.simulation == simulation]
    texts = [_written(played, assessments) for played in shown]
    columns = min(len(shown), _COLUMNS)
    rows = -(-len(shown) // columns)
    above_in = max(map(len, texts)) * _LINE_IN + 0.15
    row_in = above_in + 3.95
    height_in = 0.95 + rows * row_in + 0.4
    figure = new_figure(height_in)
    title = f"Simulation {simulation}, the paper's figure {FIGURE_OF[simulation]}: {TITLES[simulation]}"
    head(figure, _LEFT, ((title, HEAD, "bold", INK),))
    for number, (played, text) in enumerate(zip(shown, texts, strict=True)):
        row, column = divmod(number, columns)
        top = 1.0 - (0.85 + row * row_in + above_in) / height_in
        width = (_RIGHT - _LEFT) / columns
        cells = figure.add_gridspec(
            3, 1, left=_LEFT + column * width, right=_LEFT + (column + 1) * width - 0.025, top=top,
            bottom=top - 3.4 / height_in, hspace=0.1, height_ratios=(1.3, 1.0, 1.0),
        )  # fmt: skip
        panels = [figure.add_subplot(cells[place]) for place in range(3)]
        _draw(panels, played, left=column == 0)
        for place, (words, colour, weight) in enumerate(reversed(text)):
            _write_above(panels[0], place, words, colour, weight=weight)
        panels[-1].set_xlabel("time, s", fontsize=LABEL)
    _legend(figure, 0.62 / height_in, len(_SIGNS))
    return figure


def _written(played: PlayedRun, assessments: Sequence[Assessment]) -> list[tuple[str, str, str]]:
    """Return the lines above a column: text, colour, weight."""
    heading = interpretation_title(played.run.interpretation, table=played.run.simulation in WITH_TABLE)
    lines = [(part, INK, "bold") for part in wrap(heading, _LETTERS - 6)]
    lines.append((_figures(played), INK, "normal"))
    for assessment in _of(played, assessments):
        seen = "" if assessment.holds is None else f" ({assessment.seen})"
        text = f"{_WORDS[assessment.holds]}: {assessment.result}{seen}"
        parts = wrap(text, _LETTERS, subsequent_indent="   ")
        lines += [(part, _COLOURS[assessment.holds], "normal") for part in parts]
    return lines


def page_figure(played_runs: Sequence[PlayedRun], assessments: Sequence[Assessment]) -> Figure:
    """Return all five figures side by side: the positions, with one row for each interpretation."""
    interpretations = sorted({played.run.interpretation for played in played_runs})
    found = {(played.run.simulation, played.run.interpretation): played for played in played_runs}
    row_in, top_in = 1.02, 0.95
    height_in = top_in + row_in * len(interpretations) + 0.75
    figure = new_figure(height_in)
    title = "The paper's five simulations in each interpretation: positions in mm; mean error before → after half time"
    head(figure, 0.01, ((title, HEAD, "bold", INK),))
    left, width = 0.135, 0.173
    for column, simulation in enumerate(SIMULATIONS):
        heading = "\n".join((f"{simulation} (figure {FIGURE_OF[simulation]})", *wrap(TITLES[simulation], 22)))
        figure.text(
            left + column * width, 1.0 - (top_in + 0.02) / height_in, heading, fontsize=NORMAL, fontweight="bold",
            color=INK, va="bottom",
        )  # fmt: skip
    for row, interpretation in enumerate(interpretations):
        bottom = 1.0 - (top_in + (row + 1) * row_in - 0.04) / height_in
        name = interpretation_title(interpretation).replace(", ", "\n")
        figure.text(0.01, bottom + 0.32 / height_in, name, fontsize=SMALL, color=INK, va="center")
        for column, simulation in enumerate(SIMULATIONS):
            played = found.get((simulation, interpretation))
            across = left + column * width
            if played is None:
                text = f"no table: as {interpretation.noise} in SI"
                figure.text(across, bottom + 0.32 / height_in, text, fontsize=SMALL, color=STATUS["unknown"])
                continue
            panel = figure.add_axes((across, bottom, width - 0.022, 0.64 / height_in))
            last = row == len(interpretations) - 1 or (simulation, interpretations[row + 1]) not in found
            _draw_cell(panel, played, assessments, is_last=last, is_left=column == 0)
    signs = (_SIGNS[0], _SIGNS[1], _SIGNS[4])
    _legend(figure, 1.0 - 0.22 / height_in, len(signs), signs)
    return figure


def _draw_cell(
    panel: Axes, played: PlayedRun, assessments: Sequence[Assessment], *, is_last: bool, is_left: bool
) -> None:
    _draw_position(panel, played)
    panel.set_yticks((60, 80))
    panel.tick_params(labelleft=is_left, labelbottom=is_last)
    if is_last:
        panel.set_xlabel("s", fontsize=SMALL, labelpad=0.0)
    text, all_hold = summary(_of(played, assessments))
    error = f"{played.before.error_pct:.2f} → {played.after.error_pct:.2f} %"
    _write_above(panel, 0, error, INK)
    short = "undecided" if all_hold is None else text.replace("result holds", "holds").replace("results hold", "hold")
    _write_above(panel, 0, short, _COLOURS[all_hold], right=True)


def _of(played: PlayedRun, assessments: Sequence[Assessment]) -> list[Assessment]:
    """Return the assessments of this run."""
    own = played.run.simulation, played.run.interpretation
    return [each for each in assessments if (each.simulation, each.interpretation) == own]


def _write_above(
    panel: Axes, place: int, text: str, colour: str, *, weight: str = "normal", right: bool = False
) -> None:
    """Write `text` above the panel, `place` lines higher, at its left or at its right."""
    panel.annotate(
        text, (float(right), 1.0), xycoords="axes fraction", xytext=(0, 3 + _LINE_PT * place),
        textcoords="offset points", ha="right" if right else "left", fontsize=SMALL, color=colour, fontweight=weight,
    )  # fmt: skip


def _figures(played: PlayedRun) -> str:
    before, after = played.before, played.after
    return (
        f"error {before.error_pct:.2f} → {after.error_pct:.2f} %,"
        f"  limit cycles {before.limit_cycles} → {after.limit_cycles} of {after.dwells}"
    )


def _draw(panels: Sequence[Axes], played: PlayedRun, *, left: bool) -> None:
    """Draw the three panels of one run; with `left` they carry the names of the quantities."""
    curves = played.curves
    position, current, speed = panels
    _draw_position(position, played)
    for panel, low, high, values, colour in (
        (current, curves.current_low_ma, curves.current_high_ma, curves.current_ma, COMMAND),
        (speed, curves.speed_low_m_per_s, curves.speed_high_m_per_s, curves.velocity_m_per_s, POSITION),
    ):
        # bounds are broad and pale, below the curve: a bound is visible where the curve touches it
        for bound in (high, low):
            line(panel, curves.time_s, bound, BOUND, width=2.2, alpha=0.55, zorder=2.0)
        line(panel, curves.time_s, values, colour, width=0.9)
        _dress(panel, played)
    for panel, limits, ticks, quantity in zip(panels, _LIMITS, _TICKS, _QUANTITIES, strict=True):
        panel.set_ylim(*limits)
        panel.set_yticks(ticks)
        if left:
            panel.set_ylabel(quantity, fontsize=NORMAL)
    for panel in panels[:-1]:
        panel.tick_params(labelbottom=False)


def _draw_position(panel: Axes, played: PlayedRun) -> None:
    curves = played.curves
    line(panel, curves.time_s, curves.setpoint_m * 1e3, SETPOINT, width=0.9, zorder=3.0)
    line(panel, curves.time_s, curves.position_m * 1e3, POSITION, width=1.2)
    _dress(panel, played)
    panel.set_ylim(*_LIMITS[0])


def _dress(panel: Axes, played: PlayedRun) -> None:
    end_s = float(played.curves.time_s[-1])
    dress(panel, grid="y")
    panel.set_xlim(0.0, end_s)
    if played.run.simulation in WITH_TABLE:
        panel.axvline(end_s / 2.0, color=MEASURED, linewidth=1.0, linestyle=(0, (4, 3)), zorder=1)


def _legend(figure: Figure, below_top: float, columns: int, signs: Sequence[tuple[Line2D, str]] = _SIGNS) -> None:
    figure.legend(
        [sign for sign, _ in signs], [text for _, text in signs], loc="upper right",
        bbox_to_anchor=(0.985, 1.0 - below_top), ncols=columns, frameon=False, fontsize=NORMAL, borderpad=0.0,
    )  # fmt: skip
