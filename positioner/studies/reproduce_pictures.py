"""The pictures of `positioner reproduce`: the paper's figures 4 to 8, and all of them on one page. Shell.

Each shows the paper's three panels: position and setpoint, current with its bounds, speed with its bounds.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from positioner.studies.interpretations import Interpretation, NoiseKind, Units
from positioner.studies.published_results import summary
from positioner.studies.reproduce import SIMULATIONS, WITH_TABLE

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    import numpy as np
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

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

_BLUE, _RED, _GREEN, _ORANGE = "#0072B2", "#D55E00", "#009E73", "#E69F00"
_INK, _GREY, _FAINT = "#222222", "#8A8A8A", "#D9D9D9"
_WORDS = {True: "yes", False: "no", None: "not decided"}
_COLOURS = {True: _GREEN, False: _RED, None: _GREY}
_LIMITS = ((60.0, 95.0), (3.0, 21.0), (-2.3, 2.3))
_TICKS = ((60, 70, 80, 90), (4, 8, 12, 16, 20), (-2, -1, 0, 1, 2))
_QUANTITIES = ("position, mm", "current, mA", "speed, m/s")
_NAMES = (
    ("true position, command, true speed", _BLUE),
    ("setpoint", _RED),
    ("upper bound, where active", _ORANGE),
    ("lower bound, where active", _GREEN),
)


def interpretation_title(interpretation: Interpretation, *, table: bool = True) -> str:
    """Return the interpretation in words; without a `table` α and β have no effect."""
    noise = NOISES[interpretation.noise]
    label = noise if interpretation.noise is NoiseKind.FREE else f"{interpretation.noise}: {noise}"
    return f"{label}, {UNITS[interpretation.units]}" if table else label


def draw_figure(
    path: Path, simulation: int, played_runs: Sequence[PlayedRun], assessments: Sequence[Assessment]
) -> None:
    """Write the paper's figure of `simulation` to `path`: one column for each interpretation, with its assessments."""
    shown = [played for played in played_runs if played.run.simulation == simulation]
    figure = Figure(figsize=(1.0 + 5.2 * len(shown), 10.0), dpi=100, facecolor="white")
    FigureCanvasAgg(figure)
    grid = figure.subplots(3, len(shown), sharex=True, squeeze=False)
    width, height = figure.get_size_inches()
    figure.subplots_adjust(left=0.75 / width, right=1.0 - 0.45 / width, top=1.0 - 2.15 / height, bottom=0.85 / height)
    figure.subplots_adjust(hspace=0.08, wspace=0.14)
    for column, played in enumerate(shown):
        panels = [row[column] for row in grid]
        _draw(panels, played, left=column == 0)
        heading = interpretation_title(played.run.interpretation, table=simulation in WITH_TABLE)
        own = _of(played, assessments)
        _write_above(panels[0], len(own) + 1.4, heading, _INK, weight="bold")
        _write_above(panels[0], len(own) + 0.4, _figures(played), _INK)
        for line, assessment in enumerate(reversed(own)):
            seen = "" if assessment.holds is None else f" ({assessment.seen})"
            text = f"{_WORDS[assessment.holds]}: {assessment.result}{seen}"
            _write_above(panels[0], line + 0.4, text, _COLOURS[assessment.holds])
        panels[-1].set_xlabel("time, s", fontsize=11)
    title = f"Simulation {simulation}, the paper's figure {FIGURE_OF[simulation]}: {TITLES[simulation]}"
    figure.text(0.75 / width, 1.0 - 0.42 / height, title, fontsize=17, fontweight="bold", color=_INK)
    _legend(figure)
    figure.savefig(path)


def draw_page(path: Path, played_runs: Sequence[PlayedRun], assessments: Sequence[Assessment]) -> None:
    """Write all five figures side by side to `path`: one row for each interpretation."""
    interpretations = sorted({played.run.interpretation for played in played_runs})
    found = {(played.run.simulation, played.run.interpretation): played for played in played_runs}
    figure = Figure(figsize=(24.0, 1.6 + 4.7 * len(interpretations)), dpi=100, facecolor="white")
    FigureCanvasAgg(figure)
    _, height = figure.get_size_inches()
    blocks = figure.add_gridspec(
        len(interpretations), 1, left=0.045, right=0.99, top=1.0 - 1.55 / height, bottom=0.75 / height, hspace=0.17
    )
    for row, interpretation in enumerate(interpretations):
        block = blocks[row]
        cells = block.subgridspec(3, len(SIMULATIONS), hspace=0.07, wspace=0.1, height_ratios=(1.5, 1.0, 1.0))
        for column, simulation in enumerate(SIMULATIONS):
            played = found.get((simulation, interpretation))
            if played is None:
                beside = figure.add_subplot(cells[:, column])
                beside.axis("off")
                text = f"no table: α and β have no effect,\nsee {interpretation.noise} in SI"
                beside.text(0.5, 0.5, text, ha="center", va="center", color=_GREY, fontsize=12)
                continue
            panels = [figure.add_subplot(cells[panel, column]) for panel in range(3)]
            _draw(panels, played, left=simulation == SIMULATIONS[0] or (simulation - 1, interpretation) not in found)
            for panel in panels[:-1]:
                panel.tick_params(labelbottom=False)
            text, all_hold = summary(_of(played, assessments))
            _write_above(panels[0], 0.4, _figures(played), _INK)
            _write_above(panels[0], 0.4, text, _COLOURS[all_hold], right=True)
        box = block.get_position(figure)
        name = interpretation_title(interpretation).replace(", α", "\nα")
        middle = (box.y0 + box.y1) / 2.0
        figure.text(0.005, middle, name, rotation=90, ha="left", va="center", fontsize=12, fontweight="bold")
    columns = blocks[0].subgridspec(1, len(SIMULATIONS), wspace=0.1)
    for column, simulation in enumerate(SIMULATIONS):
        left = columns[column].get_position(figure).x0
        heading = f"{simulation} (figure {FIGURE_OF[simulation]}): {TITLES[simulation]}"
        figure.text(left, 1.0 - 1.1 / height, heading, fontsize=13, fontweight="bold", color=_INK)
    title = "The paper's five simulations in each interpretation of the paper"
    figure.text(0.045, 1.0 - 0.6 / height, title, fontsize=20, fontweight="bold", color=_INK)
    _legend(figure)
    figure.savefig(path)


def _of(played: PlayedRun, assessments: Sequence[Assessment]) -> list[Assessment]:
    """Return the assessments of this run."""
    own = played.run.simulation, played.run.interpretation
    return [each for each in assessments if (each.simulation, each.interpretation) == own]


def _write_above(
    panel: Axes, line: float, text: str, colour: str, *, weight: str = "normal", right: bool = False
) -> None:
    """Write `text` above the panel, `line` lines higher, at its left or at its right."""
    panel.annotate(
        text, (float(right), 1.0), xycoords="axes fraction", xytext=(0, 4 + 14 * line), textcoords="offset points",
        ha="right" if right else "left", fontsize=8.8, color=colour, fontweight=weight,
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
    half_s = float(curves.time_s[-1]) / 2.0
    position, current, speed = panels
    _step(position, curves.time_s, curves.position_m * 1e3, _BLUE)
    _step(position, curves.time_s, curves.setpoint_m * 1e3, _RED, width=0.9)
    for panel, low, high, values in (
        (current, curves.current_low_ma, curves.current_high_ma, curves.current_ma),
        (speed, curves.speed_low_m_per_s, curves.speed_high_m_per_s, curves.velocity_m_per_s),
    ):
        # bounds are broad and pale, below the curve: a bound is visible where the curve touches it
        _step(panel, curves.time_s, high, _ORANGE, width=1.6, alpha=0.6)
        _step(panel, curves.time_s, low, _GREEN, width=1.6, alpha=0.6)
        _step(panel, curves.time_s, values, _BLUE)
    for panel, limits, ticks, quantity in zip(panels, _LIMITS, _TICKS, _QUANTITIES, strict=True):
        panel.set_ylim(*limits)
        panel.set_xlim(0.0, float(curves.time_s[-1]))
        panel.spines[["top", "right"]].set_visible(False)
        panel.spines[["left", "bottom"]].set_color(_GREY)
        panel.tick_params(colors=_INK, labelsize=9)
        panel.set_yticks(ticks)
        panel.grid(axis="y", color=_FAINT, linewidth=0.5)
        panel.set_axisbelow(True)
        if played.run.simulation in WITH_TABLE:
            panel.axvline(half_s, color=_GREY, linewidth=0.8, linestyle=(0, (4, 3)), zorder=1)
        if left:
            panel.set_ylabel(quantity, fontsize=11)


def _step(
    panel: Axes,
    time_s: NDArray[np.float64],
    values: NDArray[np.float64],
    colour: str,
    *,
    width: float = 0.9,
    alpha: float = 1.0,
) -> None:
    panel.plot(time_s, values, color=colour, linewidth=width, alpha=alpha, drawstyle="steps-post")


def _legend(figure: Figure) -> None:
    lines = [Line2D([], [], color=colour, linewidth=2.0) for _, colour in _NAMES]
    lines.append(Line2D([], [], color=_GREY, linewidth=0.8, linestyle=(0, (4, 3))))
    names = [*(name for name, _ in _NAMES), "use of the table begins"]
    figure.legend(lines, names, loc="lower center", ncols=len(names), frameon=False, fontsize=11)
