"""The picture of a diagnosis: trend with half periods, PV or stem over OP, and what each method says. Shell."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np

from positioner.diagnostics.indirect.oscillation import rising_crossings, smoothed
from positioner.diagnostics.verdict import Verdict
from positioner.errors import writing

mpl.use("Agg")
from matplotlib import pyplot as plt

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from positioner.diagnostics.finding import Finding
    from positioner.diagnostics.indirect.method import Answer
    from positioner.diagnostics.loop_table import LoopTable

    Array = NDArray[np.float64]

_SHOWN_PERIODS = 12.0
_SHOWN_SLIPS = 12
_COLORS = {Verdict.YES: "C3", Verdict.NO: "C2", Verdict.UNDECIDED: "0.6"}


def draw(path: Path, table: LoopTable, finding: Finding, command: Array) -> None:
    """Draw into `path`; `command` is OP in percent."""
    figure = plt.figure(figsize=(15.0, 7.5), layout="constrained")
    grid = figure.add_gridspec(2, 3, width_ratios=(1.0, 1.0, 1.15))
    first, second = figure.add_subplot(grid[0, :2]), figure.add_subplot(grid[1, :2])
    right = figure.add_subplot(grid[0, 2] if finding.indirect else grid[:, 2])
    second.sharex(first)
    time: Array = np.arange(command.size, dtype=np.float64) * (table.period_s if table.is_timed else 1.0)
    begin, end = _shown(finding, command.size)
    _trend(first, second, time[begin:end], table, finding, command, slice(begin, end))
    if table.stem is not None and finding.direct:
        _stem_loop(right, table.stem, command, finding)
    elif table.pv is not None:
        _pv_loop(right, table.pv, command, slice(begin, end))
    if finding.indirect:
        _answers(figure.add_subplot(grid[1, 2]), finding.indirect.answers)
    unit = "s" if table.is_timed else "samples"
    second.set_xlabel(f"time, {unit}: {begin} to {end} of {command.size} samples")
    stick = finding.stick
    size = f"; S {stick.value:.2f} % ({stick.low:.2f} to {stick.high:.2f})" if stick else ""
    figure.suptitle(f"{finding.source}: stiction: {finding.verdict}{size}\n{finding.reason}", color=_title(finding))
    with writing(path):
        figure.savefig(path, dpi=100)
    plt.close(figure)


def _title(finding: Finding) -> str:
    return "black" if finding.verdict is Verdict.UNDECIDED else _COLORS[finding.verdict]


def _shown(finding: Finding, count: int) -> tuple[int, int]:
    """Return the samples that the trend shows: some periods or slips in the middle of the record."""
    length = float(count)
    if finding.direct and len(finding.direct.slips) > _SHOWN_SLIPS:
        slips = finding.direct.slips
        middle = len(slips) // 2
        begin = slips[max(middle - _SHOWN_SLIPS // 2, 0)].before.begin
        return begin, min(slips[min(middle + _SHOWN_SLIPS // 2, len(slips) - 1)].after.end, count)
    if finding.indirect:
        length = min(length, max(_SHOWN_PERIODS * finding.indirect.oscillation.period, 200.0))
    begin = max(int(0.5 * (count - length)), 0)
    return begin, min(begin + math.ceil(length), count)


def _trend(
    first: Axes, second: Axes, time: Array, table: LoopTable, finding: Finding, command: Array, part: slice
) -> None:
    first.plot(time, command[part], color="C0", lw=1.0)
    first.set_ylabel("OP, %", color="C0")
    first.tick_params(labelbottom=False)
    if table.stem is not None:
        beside = first.twinx()
        beside.plot(time, table.stem[part], color="C1", lw=1.0)
        beside.set_ylabel("stem position", color="C1")
    if table.pv is not None:
        second.plot(time, table.pv[part], color="C2", lw=1.0, label="PV")
        if table.sp is not None:
            second.plot(time, table.sp[part], color="0.4", lw=0.8, ls="--", label="SP")
        second.legend(loc="upper right")
        second.set_ylabel("PV")
    elif finding.direct:
        _pull(second, time, table, finding, command, part)
    if finding.indirect:
        period = finding.indirect.oscillation.period
        step = table.period_s if table.is_timed else 1.0
        for crossing in rising_crossings(command, period):
            if part.start <= crossing < part.stop:
                for axes in (first, second):
                    axes.axvline(crossing * step, color="0.85", lw=0.8, zorder=0)
        first.set_title(f"Lines: periods of OP, {period * step:.4g} {'s' if table.is_timed else 'samples'} in the mean")


def _pull(axes: Axes, time: Array, table: LoopTable, finding: Finding, command: Array, part: slice) -> None:
    """Draw the command less the spring, which lies within ± F_s of a stem that rests."""
    friction = finding.direct.friction if finding.direct else None
    if friction is None or table.stem is None:
        axes.set_axis_off()
        return
    axes.plot(time, command[part] - friction.offset - friction.slope * table.stem[part], color="C4", lw=1.0)
    for size, style in ((friction.static, "--"), (friction.sliding, ":")):
        for side in (-1.0, 1.0):
            axes.axhline(side * size, color="k", ls=style, lw=0.9)
    axes.set_ylabel("command less spring, %")
    axes.set_title("Friction; dashed: static, dotted: sliding")


def _stem_loop(axes: Axes, stem: Array, command: Array, finding: Finding) -> None:
    axes.plot(command, stem, color="0.7", lw=0.5, zorder=0)
    direct = finding.direct
    if direct:
        for side, mark in ((1.0, "^"), (-1.0, "v")):
            chosen = [slip for slip in direct.slips if slip.direction == side]
            places = [slip.before.place for slip in chosen], [slip.after.place for slip in chosen]
            axes.plot([slip.command_at_slip for slip in chosen], places[0], f"C3{mark}", ms=4.0)
            axes.plot([slip.command_at_stop for slip in chosen], places[1], f"C0{mark}", ms=4.0)
    if direct and direct.friction:
        friction = direct.friction
        place = np.linspace(float(np.min(stem)), float(np.max(stem)), 2)
        spring = friction.offset + friction.slope * place
        for side in (-1.0, 1.0):
            axes.plot(spring + side * friction.static, place, "C3--", lw=1.0)
            axes.plot(spring + side * friction.sliding, place, "C0:", lw=1.2)
    axes.set(xlabel="OP, %", ylabel="stem position", title="Red: slips, static friction; blue: stops, sliding friction")


def _pv_loop(axes: Axes, pv: Array, command: Array, part: slice) -> None:
    width = max((part.stop - part.start) // 200, 1)
    axes.plot(smoothed(command[part], width), smoothed(pv[part], width), color="C4", lw=0.9)
    axes.set(xlabel="OP, %", ylabel="PV", title="PV over OP, the stretch on the left")


def _answers(axes: Axes, answers: tuple[Answer, ...]) -> None:
    for row, each in enumerate(answers):
        index = "no index" if math.isnan(each.index) else f"{each.index:.3g}"
        limits = f"(yes > {each.yes_above:.3g})"
        axes.barh(row, 1.0, color=_COLORS[each.verdict], alpha=0.75)
        axes.text(0.02, row, f"{each.name}  {index}  {limits}", va="center")
        axes.text(0.98, row, str(each.verdict), va="center", ha="right")
    axes.set(ylim=(len(answers) - 0.5, -0.5), xlim=(0.0, 1.0), title="Methods on OP and PV")
    axes.set_xticks([])
    axes.set_yticks([])
