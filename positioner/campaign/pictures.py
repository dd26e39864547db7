"""The pictures of a campaign: the effect of each parameter, and where the worst corners lie. Shell: writes files."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from positioner.campaign.check import shown
from positioner.campaign.schema import Scale

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from matplotlib.axes import Axes

    from positioner.campaign.design import Parameter
    from positioner.campaign.plan import Campaign
    from positioner.campaign.run import PlayedRun
    from positioner.campaign.summary import Effect, Summary

_PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#999999", "#8B5E3C")
_MARKS = ("o", "s", "^", "v", "D", "P", "X", "<", ">")
_FAINT = "#BBBBBB"
_LEAST_SHOWN_PCT = 1e-3
"""A smaller error is drawn here."""
_COLUMNS = 3
_PAPER = {"facecolor": "white", "edgecolor": "none", "pad": 1.0, "alpha": 0.75}
"""What lies below a text."""
_TICKS = 5


def draw_sensitivity(path: Path, campaign: Campaign, played: Sequence[PlayedRun], summary: Summary) -> None:
    """Draw the mean error over each parameter: every run as a dot, the means of the parts with their intervals."""
    columns = min(_COLUMNS, len(campaign.parameters))
    rows = math.ceil(len(campaign.parameters) / columns)
    figure = Figure(figsize=(5.0 * columns + 0.6, 3.9 * rows + 1.3), dpi=110)
    FigureCanvasAgg(figure)
    panels = figure.subplots(rows, columns, sharey=True, squeeze=False)
    laws = [law.law for law in summary.laws]
    for place, parameter in enumerate(campaign.parameters):
        panel = panels[place // columns][place % columns]
        for law in laws:
            _draw_runs(panel, parameter, place, [each for each in played if each.run.law == law], _color(laws, law))
        explained = []
        for effect in summary.effects:
            if effect.parameter == parameter.name:
                _draw_effect(panel, effect, laws)
                share = "–" if effect.explained is None else f"{100.0 * effect.explained:.0f} %"
                explained.append(f"{effect.law} {share}")
        _label(panel, parameter, f"explained: {', '.join(explained)}")
        if place % columns == 0:
            panel.set_ylabel("mean |error|, % of span")
    for spare in range(len(campaign.parameters), rows * columns):
        panels[spare // columns][spare % columns].set_axis_off()
    if laws:
        handles, labels = panels[0][0].get_legend_handles_labels()
        figure.legend(handles, labels, frameon=False, ncols=len(laws), loc="upper right", fontsize=10)
    _head(figure, f"{campaign.file.title}: effect of each parameter, with 95 % intervals")
    figure.tight_layout(rect=(0.0, 0.0, 1.0, 1.0 - 0.55 / figure.get_figheight()))
    figure.savefig(path)


def _color(laws: Sequence[str], law: str) -> str:
    return _PALETTE[laws.index(law) % len(_PALETTE)]


def _draw_runs(panel: Axes, parameter: Parameter, place: int, played: Sequence[PlayedRun], color: str) -> None:
    found = [(each.run.values[place], each.outcome.figures) for each in played]
    where = [parameter.place_of(value) for value, figures in found if figures]
    errors = [max(figures.mean_abs_error_pct, _LEAST_SHOWN_PCT) for _, figures in found if figures]
    panel.plot(where, errors, ".", color=color, alpha=0.35, markersize=5.0, markeredgewidth=0.0, zorder=1)


def _draw_effect(panel: Axes, effect: Effect, laws: Sequence[str]) -> None:
    # laws beside each other, so that equal intervals do not hide each other
    index = laws.index(effect.law)
    narrowest = min(part.end - part.begin for part in effect.parts)
    shift = 0.3 * narrowest * ((index + 0.5) / len(laws) - 0.5)
    where = [(part.begin + part.end) / 2.0 + shift for part in effect.parts]
    means = [max(part.error.mean_pct, _LEAST_SHOWN_PCT) for part in effect.parts]
    limits = [
        (
            mean if part.error.low_pct is None else part.error.low_pct,
            mean if part.error.high_pct is None else part.error.high_pct,
        )
        for part, mean in zip(effect.parts, means, strict=True)
    ]
    below = [max(mean - max(low, _LEAST_SHOWN_PCT), 0.0) for mean, (low, _) in zip(means, limits, strict=True)]
    above = [max(high - mean, 0.0) for mean, (_, high) in zip(means, limits, strict=True)]
    panel.errorbar(
        where, means, yerr=(below, above), fmt=f"{_MARKS[index % len(_MARKS)]}-", color=_color(laws, effect.law),
        markersize=5, linewidth=1.3, label=effect.law, zorder=2,
    )  # fmt: skip


def _label(panel: Axes, parameter: Parameter, text: str) -> None:
    """Give a panel its scale, which has the values of the parameter at places from 0 to 1."""
    values = parameter.range.values
    if values is not None and len(values) <= 2 * _TICKS:
        places = [(number + 0.5) / len(values) for number in range(len(values))]
        panel.set_xticks(places, [shown(value) for value in values], rotation=15 if len(values) > _TICKS else 0)
    else:
        places = [tick / (_TICKS - 1) for tick in range(_TICKS)]
        panel.set_xticks(places, [shown(parameter.value_at(place)) for place in places])
    panel.set_xlim(-0.02, 1.02)
    panel.set_yscale("log")
    panel.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    scale = ", logarithmic" if parameter.range.scale is Scale.LOGARITHMIC else ""
    panel.set_xlabel(f"{parameter.name}{scale}", fontsize=9)
    panel.set_title(text, loc="left", fontsize=10)
    panel.grid(axis="y", color="#DDDDDD", linewidth=0.6)
    panel.spines[["top", "right"]].set_visible(False)


def draw_corners(
    path: Path, campaign: Campaign, played: Sequence[PlayedRun], corners: Sequence[tuple[PlayedRun, str]]
) -> None:
    """Draw every run as a line through the values of its parameters, and the worst ones with their commands."""
    names = [each.name for each in campaign.parameters]
    height = 4.6 + 0.42 * len(corners)
    figure = Figure(figsize=(max(11.0, 2.4 * len(names)), height), dpi=110)
    FigureCanvasAgg(figure)
    bottom = (0.42 * len(corners) + 0.9) / height
    panel = figure.add_axes((0.07, bottom, 0.86, 1.0 - bottom - 0.75 / height))
    axis = range(len(names))
    for values in dict.fromkeys(each.run.values for each in played):
        panel.plot(axis, _places(campaign, values), color=_FAINT, linewidth=0.6, alpha=0.6, marker=".", zorder=1)
    for number, (corner, command) in enumerate(corners):
        color = _PALETTE[number % len(_PALETTE)]
        panel.plot(
            axis, _places(campaign, corner.run.values), color=color, linewidth=2.0,
            marker=_MARKS[number % len(_MARKS)], zorder=3 + len(corners) - number,
        )  # fmt: skip
        figures = corner.outcome.figures
        found = "failed" if figures is None else f"{figures.worst_mean_abs_error_pct:.2f} %"
        y = (0.42 * (len(corners) - number) - 0.16) / height
        text = f"{_SIGNS[number % len(_SIGNS)]} {corner.run.law}, seed {corner.run.seed}: {found} in the worst dwell"
        figure.text(0.07, y + 0.17 / height, text, color=color, fontsize=9.5, fontweight="bold", va="center")
        figure.text(0.085, y, command, color="#222222", fontsize=8, family="monospace", va="center")
    for place, parameter in enumerate(campaign.parameters):
        panel.axvline(place, color="#666666", linewidth=0.8, zorder=2)
        for value in parameter.range.values or map(parameter.value_at, (0.0, 1.0)):
            panel.annotate(
                shown(value), (place, parameter.place_of(value)), xytext=(7, 0), textcoords="offset points",
                va="center", fontsize=8.5, annotation_clip=False, zorder=99, bbox=_PAPER,
            )  # fmt: skip
    panel.set_xticks(axis, [name.replace(".", ".\n") for name in names], fontsize=8.5)
    panel.tick_params(axis="x", length=0, pad=14)
    panel.set_yticks([])
    panel.set_ylim(0.0, 1.0)
    panel.set_xlim(-0.3, len(names) - 0.7)
    panel.set_frame_on(False)
    _head(figure, f"{campaign.file.title}: the worst corners")
    figure.savefig(path)


_SIGNS = ("●", "■", "▲", "▼", "◆", "✚", "✖", "◀", "▶")


def _places(campaign: Campaign, values: Sequence[object]) -> list[float]:
    return [parameter.place_of(value) for parameter, value in zip(campaign.parameters, values, strict=True)]  # type: ignore[arg-type]


def _head(figure: Figure, text: str) -> None:
    figure.text(0.01, 1.0 - 0.3 / figure.get_figheight(), text, fontsize=13, fontweight="bold", ha="left", va="center")
