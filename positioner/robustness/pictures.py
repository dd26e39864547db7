"""The pictures of the robustness test: errors over each factor, lost dwells by class. Shell: writes files."""

from __future__ import annotations

import math
from textwrap import wrap
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.ticker import FuncFormatter

from positioner.pictures.colours import FAINT, INK, MARKS, SERIES
from positioner.pictures.files import save
from positioner.pictures.panels import HEAD, LABEL, NORMAL, SMALL, dress, head, new_figure

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from matplotlib.axes import Axes

    from positioner.robustness.judgement import Bin, Distribution

_LEAST_PCT = 1e-3
_COLUMNS = 4
_LETTERS = 34


def draw_lost(path: Path, rows: Sequence[tuple[str, Distribution]], title: str) -> None:
    """Draw the lost dwells of every law in every class, in percent with their 95 % limits."""
    classes = list(dict.fromkeys(name for name, _ in rows))
    laws = list(dict.fromkeys(each.law for _, each in rows))
    figure = new_figure(max(0.42 * len(classes) * 1.6 + 1.6, 4.2))
    panel = figure.subplots()
    for place, law in enumerate(laws):
        found = [(classes.index(name), each.lost) for name, each in rows if each.law == law]
        shift = 0.7 * ((place + 0.5) / len(laws) - 0.5)
        parts = [100.0 * rate.count / rate.of for _, rate in found]
        limits = [tuple(100.0 * each for each in rate.limits) for _, rate in found]
        below = [part - low for part, (low, _) in zip(parts, limits, strict=True)]
        above = [high - part for part, (_, high) in zip(parts, limits, strict=True)]
        panel.errorbar(
            parts, [number + shift for number, _ in found], xerr=(below, above), fmt=MARKS[place % len(MARKS)],
            color=SERIES[place % len(SERIES)], markersize=5.0, linewidth=1.3, label=law,
        )  # fmt: skip
    for number in range(1, len(classes)):
        panel.axhline(number - 0.5, color=FAINT, linewidth=0.8)
    panel.set_yticks(range(len(classes)), classes, fontsize=NORMAL)
    panel.invert_yaxis()
    panel.set_xscale("symlog", linthresh=0.1)
    panel.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    panel.set_xlim(0.0, 100.0)
    panel.set_xlabel("lost dwells, % of those that were played, with 95 % limits", fontsize=LABEL)
    dress(panel, grid="x")
    panel.legend(frameon=False, fontsize=NORMAL, ncols=len(laws), loc="lower right", bbox_to_anchor=(1.0, 1.0))
    head(figure, 0.01, ((title, HEAD, "bold", INK),))
    figure.tight_layout(rect=(0.0, 0.0, 1.0, 1.0 - 0.5 / figure.get_figheight()))
    save(figure, path)


def draw_factors(path: Path, found: Sequence[Bin], title: str) -> None:
    """Draw median and 99 % of the error over each factor: of the judged law, and of the best baseline in each bin."""
    names = list(dict.fromkeys(each.factor for each in found))
    rows = math.ceil(len(names) / _COLUMNS)
    figure = new_figure(2.5 * rows + 0.9)
    panels = figure.subplots(rows, _COLUMNS, sharey=True, squeeze=False)
    for place, name in enumerate(names):
        panel = panels[place // _COLUMNS][place % _COLUMNS]
        _draw_factor(panel, [each for each in found if each.factor == name])
        panel.set_title("\n".join(wrap(name, _LETTERS)), loc="left", fontsize=SMALL, color=INK)
        if place % _COLUMNS == 0:
            panel.set_ylabel("|error|, % of span", fontsize=LABEL)
    for spare in range(len(names), rows * _COLUMNS):
        panels[spare // _COLUMNS][spare % _COLUMNS].set_axis_off()
    height_in = figure.get_figheight()
    if names:
        handles, labels = panels[0][0].get_legend_handles_labels()
        figure.legend(
            handles, labels, frameon=False, ncols=4, loc="upper right", fontsize=NORMAL,
            bbox_to_anchor=(1.0, 1.0 - 0.4 / height_in),
        )  # fmt: skip
    head(figure, 0.01, ((title, HEAD, "bold", INK),))
    figure.tight_layout(rect=(0.0, 0.0, 1.0, 1.0 - 0.8 / height_in), h_pad=1.2)
    save(figure, path)


def _draw_factor(panel: Axes, parts: Sequence[Bin]) -> None:
    middles = np.array([0.5 * (each.low + each.high) for each in parts])
    spreads = [each.high / each.low if each.low > 0.0 else 1.0 for each in parts]
    is_logarithmic = bool(parts) and parts[0].low > 0.0 and math.prod(spreads) > 10.0  # noqa: PLR2004 - a decade
    if is_logarithmic:
        middles = np.array([math.sqrt(each.low * each.high) for each in parts])
    series = (
        (0, "median", "-", [each.law for each in parts]),
        (2, "99 %", "--", [each.law for each in parts]),
        (0, "median", "-", [each.best or each.law for each in parts]),
        (2, "99 %", "--", [each.best or each.law for each in parts]),
    )
    shown = series if any(each.best for each in parts) else series[:2]
    for number, (quantile, text, line, rows) in enumerate(shown):
        who, color = (rows[0].law, SERIES[0]) if number < 2 else ("best baseline", SERIES[1])  # noqa: PLR2004
        values = [max(each.quantiles_pct[quantile], _LEAST_PCT) for each in rows]
        mark = MARKS[number // 2]
        panel.plot(middles, values, f"{mark}{line}", color=color, markersize=4.0, linewidth=1.2, label=f"{who}, {text}")
    low, high = min(each.low for each in parts), max(each.high for each in parts)
    if low < high:
        panel.set_xlim(low, high)
    panel.axhline(1.0, color=FAINT, linewidth=1.0)
    if is_logarithmic:
        panel.set_xscale("log")
        panel.xaxis.set_minor_formatter(FuncFormatter(lambda _value, _: ""))
    panel.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    panel.set_yscale("log")
    panel.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    panel.tick_params(labelsize=SMALL)
    dress(panel, grid="y")
