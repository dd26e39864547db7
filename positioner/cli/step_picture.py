"""The picture of a step response test: all responses by their step, and T86 over the size with its regions. Shell."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np
from matplotlib.ticker import FuncFormatter, NullLocator

from positioner.commissioning.step.curves import normalised
from positioner.commissioning.step.report import SIDES
from positioner.pictures.colours import CLOSING, FAINT, INK, OPENING
from positioner.pictures.files import save
from positioner.pictures.panels import HEAD, LABEL, NORMAL, SMALL, dress, head, new_figure

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from matplotlib.axes import Axes

    from positioner.commissioning.step.memory import Response
    from positioner.commissioning.step.result import StepResult

_MS = 1e3
_SHADES = {"A": "#d9d9d9", "B": "#fde0c5", "C": "#d5ecd4", "D": "#cfe1f2"}
_MEANING = {"A": "no motion", "B": "some motion", "C": "consistent", "D": "slew limited"}
_COLOURS = {1.0: OPENING, -1.0: CLOSING}


def draw(path: Path, responses: Sequence[Response], result: StepResult, valve: str) -> None:
    """Draw into `path`."""
    figure = new_figure(5.2)
    axes = figure.subplots(1, 3, width_ratios=(2.0, 2.0, 1.7))
    figure.subplots_adjust(left=0.06, right=0.985, top=0.85, bottom=0.11, wspace=0.24)
    for place, direction in zip(axes, SIDES, strict=False):
        _responses(place, [each for each in responses if each.direction == direction], result, direction)
    _regions(axes[2], result)
    loop = "open loop" if result.plan.is_open else f"closed loop with {result.law}"
    head(figure, 0.06, ((f"{valve}: step responses, {loop}", HEAD, "bold", INK),))
    save(figure, path)


@FuncFormatter
def _plain(value: float, _: object) -> str:
    return f"{value:g}"


def _label(axes: Axes, title: str, x_label: str, y_label: str) -> None:
    dress(axes)
    axes.set_title(title, loc="left", fontsize=NORMAL, color=INK)
    axes.set_xlabel(x_label, fontsize=LABEL)
    axes.set_ylabel(y_label, fontsize=LABEL)


def _responses(axes: Axes, responses: Sequence[Response], result: StepResult, direction: float) -> None:
    """Draw each response as a part of its realised step, or of the asked one where it did not move."""
    shades = mpl.colormaps["viridis"]
    for each in responses:
        gone = normalised(each, result)
        times_ms = np.arange(len(gone)) * result.period_s * _MS
        place = list(result.regions).index(each.size)
        colour = shades(place / max(len(result.regions) - 1, 1))
        fresh = each is next(other for other in responses if other.size == each.size)
        name = f"{100.0 * each.size:g} % ({result.regions[each.size]})" if fresh else None
        axes.plot(times_ms[1:], gone[1:], color=colour, lw=1.1, alpha=0.85, label=name)
    for level in (0.632, 0.865, 0.98):
        axes.axhline(level, color=FAINT, lw=1.0, ls="--", zorder=0)
    times_s = [row.spread(name).high for row in result.rows for name in ("t86_s", "t98_s")]
    longest_ms = _MS * max([value for value in times_s if not math.isnan(value)], default=result.plan.wait_s)
    axes.set(
        xscale="log",
        xlim=(result.period_s * _MS, max(4.0 * longest_ms, 10.0 * result.period_s * _MS)),
        ylim=(-0.5, 1.75),
    )
    _label(axes, f"Steps {SIDES[direction]}", "time since the step, ms", "part of the realised step")
    axes.xaxis.set_major_formatter(_plain)
    if responses:
        axes.legend(loc="upper left", fontsize=SMALL, frameon=False)


def _regions(axes: Axes, result: StepResult) -> None:
    """Draw Td and T86 over the size of the step, with the range of the repeats."""
    sizes = [100.0 * size for size in result.regions]
    edges = [sizes[0] / 1.4, *[math.sqrt(a * b) for a, b in pairwise(sizes)], sizes[-1] * 1.4]
    shown: set[str] = set()
    for region, (left, right) in zip(result.regions.values(), pairwise(edges), strict=True):
        label = None if region in shown else f"{region}: {_MEANING[region]}"
        axes.axvspan(left, right, color=_SHADES[region], lw=0.0, label=label)
        shown.add(region)
    for row in result.rows:
        for name, mark in (("dead_time_s", "v"), ("t86_s", "o")):
            spread = row.spread(name)
            if spread.count:
                middle = spread.median * _MS
                reach = [[max(middle - spread.low * _MS, 0.0)], [max(spread.high * _MS - middle, 0.0)]]
                axes.errorbar(
                    100.0 * row.size, middle, yerr=reach, fmt=mark, color=_COLOURS[row.direction], ms=6.0, capsize=3.0
                )
    for direction, side in SIDES.items():
        for mark, words in (("v", "dead time"), ("o", "T86")):
            axes.plot([], [], mark, color=_COLOURS[direction], label=f"{words}, {side}")
    axes.set(
        xscale="log",
        yscale="log",
        xlim=(edges[0], edges[-1]),
    )
    _label(axes, "Response regions", f"step, % of {result.plan.unit}", "time, ms")
    axes.set_xticks(sizes, [f"{size:g}" for size in sizes])
    axes.xaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter(_plain)
    axes.legend(fontsize=SMALL)
