"""The picture of a diagnosis: trend with half periods, PV or stem over OP, and what each method says. Shell."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from positioner.diagnostics.indirect.oscillation import rising_crossings, smoothed
from positioner.diagnostics.shown import shown_part
from positioner.diagnostics.verdict import Verdict
from positioner.errors import writing
from positioner.pictures.colours import BREAKAWAY, COMMAND, FAINT, INK, POSITION, PROCESS_VALUE, SETPOINT, STATUS
from positioner.pictures.files import save
from positioner.pictures.panels import HEAD, LABEL, NORMAL, SMALL, dress, head, new_figure

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from positioner.diagnostics.finding import Finding
    from positioner.diagnostics.indirect.method import Answer
    from positioner.diagnostics.loop_table import LoopTable

    Array = NDArray[np.float64]

_COLORS = {Verdict.YES: STATUS["failure"], Verdict.NO: STATUS["good"], Verdict.UNDECIDED: STATUS["unknown"]}


def draw(path: Path, table: LoopTable, finding: Finding, command: Array) -> None:
    """Draw into `path`; `command` is OP in percent."""
    figure = new_figure(7.0)
    grid = figure.add_gridspec(
        2, 3, width_ratios=(1.0, 1.0, 1.25), left=0.06, right=0.985, top=0.84, bottom=0.08, hspace=0.32, wspace=0.36
    )
    first, second = figure.add_subplot(grid[0, :2]), figure.add_subplot(grid[1, :2])
    right = figure.add_subplot(grid[0, 2] if finding.indirect else grid[:, 2])
    second.sharex(first)
    time: Array = np.arange(command.size, dtype=np.float64) * (table.period_s if table.is_timed else 1.0)
    begin, end = shown_part(finding, command.size)
    _trend(first, second, time[begin:end], table, finding, command, slice(begin, end))
    if table.stem is not None and finding.direct:
        _stem_loop(right, table.stem, command, finding)
    elif table.pv is not None:
        _pv_loop(right, table.pv, command, slice(begin, end))
    if finding.indirect:
        _answers(figure.add_subplot(grid[1, 2]), finding.indirect.answers)
    unit = "s" if table.is_timed else "samples"
    second.set_xlabel(f"time, {unit}: {begin} to {end} of {command.size} samples", fontsize=LABEL)
    stick = finding.stick
    size = f"; S {stick.value:.2f} % ({stick.low:.2f} to {stick.high:.2f})" if stick else ""
    verdict = f"{finding.source}: stiction: {finding.verdict}{size}"
    head(figure, 0.06, ((verdict, HEAD, "bold", _title(finding)), (finding.reason, LABEL, "normal", INK)))
    with writing(path):
        save(figure, path)


def _title(finding: Finding) -> str:
    return INK if finding.verdict is Verdict.UNDECIDED else _COLORS[finding.verdict]


def _trend(
    first: Axes, second: Axes, time: Array, table: LoopTable, finding: Finding, command: Array, part: slice
) -> None:
    first.plot(time, command[part], color=COMMAND, lw=1.2)
    dress(first)
    first.set_ylabel("OP, %", color=COMMAND, fontsize=LABEL)
    first.tick_params(labelbottom=False)
    if table.stem is not None:
        beside = first.twinx()
        beside.plot(time, table.stem[part], color=POSITION, lw=1.2)
        dress(beside)
        beside.spines["right"].set_visible(True)
        beside.set_ylabel("stem position", color=POSITION, fontsize=LABEL)
    if table.pv is not None:
        second.plot(time, table.pv[part], color=PROCESS_VALUE, lw=1.2, label="PV")
        if table.sp is not None:
            second.plot(time, table.sp[part], color=SETPOINT, lw=1.0, ls="--", label="SP")
        dress(second)
        second.legend(
            loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, fontsize=NORMAL, frameon=False, borderpad=0.0
        )
        second.set_ylabel("PV", fontsize=LABEL)
    elif finding.direct:
        _pull(second, time, table, finding, command, part)
    if finding.indirect:
        period = finding.indirect.oscillation.period
        step = table.period_s if table.is_timed else 1.0
        for crossing in rising_crossings(command, period):
            if part.start <= crossing < part.stop:
                for axes in (first, second):
                    axes.axvline(crossing * step, color=FAINT, lw=1.0, zorder=0)
        unit = "s" if table.is_timed else "samples"
        _title_of(first, f"Upright lines: periods of OP, {period * step:.4g} {unit} in the mean")


def _pull(axes: Axes, time: Array, table: LoopTable, finding: Finding, command: Array, part: slice) -> None:
    """Draw the command less the spring, which lies within ± F_s of a stem that rests."""
    friction = finding.direct.friction if finding.direct else None
    if friction is None or table.stem is None:
        axes.set_axis_off()
        return
    axes.plot(time, command[part] - friction.offset - friction.slope * table.stem[part], color=COMMAND, lw=1.2)
    for size, style in ((friction.static, "--"), (friction.sliding, ":")):
        for side in (-1.0, 1.0):
            axes.axhline(side * size, color=BREAKAWAY, ls=style, lw=1.2)
    dress(axes)
    axes.set_ylabel("command less spring, %", fontsize=LABEL)
    _title_of(axes, "Friction; dashed: static, dotted: sliding")


def _stem_loop(axes: Axes, stem: Array, command: Array, finding: Finding) -> None:
    axes.plot(command, stem, color=FAINT, lw=0.8, zorder=0, rasterized=True)
    direct = finding.direct
    if direct:
        for side, mark in ((1.0, "^"), (-1.0, "v")):
            chosen = [slip for slip in direct.slips if slip.direction == side]
            places = [slip.before.place for slip in chosen], [slip.after.place for slip in chosen]
            axes.plot([slip.command_at_slip for slip in chosen], places[0], mark, color=BREAKAWAY, ms=4.5)
            axes.plot([slip.command_at_stop for slip in chosen], places[1], mark, color=POSITION, ms=4.5)
    if direct and direct.friction:
        friction = direct.friction
        place = np.linspace(float(np.min(stem)), float(np.max(stem)), 2)
        spring = friction.offset + friction.slope * place
        for side in (-1.0, 1.0):
            axes.plot(spring + side * friction.static, place, color=BREAKAWAY, ls="--", lw=1.3)
            axes.plot(spring + side * friction.sliding, place, color=POSITION, ls=":", lw=1.6)
    dress(axes)
    axes.set_xlabel("OP, %", fontsize=LABEL)
    axes.set_ylabel("stem position", fontsize=LABEL)
    _title_of(axes, "Orange: slips, static friction (dashed)\nblue: stops, sliding friction (dotted)")


def _title_of(axes: Axes, title: str) -> None:
    axes.set_title(title, loc="left", fontsize=NORMAL, color=INK)


def _pv_loop(axes: Axes, pv: Array, command: Array, part: slice) -> None:
    width = max((part.stop - part.start) // 200, 1)
    axes.plot(smoothed(command[part], width), smoothed(pv[part], width), color=PROCESS_VALUE, lw=1.0)
    dress(axes)
    axes.set_xlabel("OP, %", fontsize=LABEL)
    axes.set_ylabel("PV", fontsize=LABEL)
    _title_of(axes, "PV over OP, the stretch on the left")


def _answers(axes: Axes, answers: tuple[Answer, ...]) -> None:
    for row, each in enumerate(answers):
        index = "no index" if math.isnan(each.index) else f"{each.index:.3g}"
        limits = f"(yes > {each.yes_above:.3g})"
        axes.barh(row, 1.0, color=_COLORS[each.verdict], alpha=0.35)
        axes.text(0.02, row, f"{each.name}  {index}  {limits}", va="center", fontsize=SMALL)
        axes.text(0.98, row, str(each.verdict), va="center", ha="right", fontsize=SMALL, fontweight="bold")
    axes.set(ylim=(len(answers) - 0.5, -0.5), xlim=(0.0, 1.0))
    _title_of(axes, "Methods on OP and PV")
    axes.set_xticks([])
    axes.set_yticks([])
