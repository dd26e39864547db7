"""The pictures of a campaign: the effect of each parameter, and where the worst corners lie. Shell: writes files."""

from __future__ import annotations

import math
from textwrap import wrap
from typing import TYPE_CHECKING

from matplotlib.ticker import FuncFormatter

from positioner.campaign.check import shown
from positioner.campaign.schema import Scale
from positioner.pictures.colours import FAINT, INK, MARKS, MEASURED, SERIES
from positioner.pictures.files import save
from positioner.pictures.panels import HEAD, LABEL, NORMAL, SMALL, dress, head, new_figure

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from matplotlib.axes import Axes

    from positioner.campaign.design import Parameter
    from positioner.campaign.plan import Campaign
    from positioner.campaign.run import PlayedRun
    from positioner.campaign.summary import Effect, Summary

_LEAST_SHOWN_PCT = 1e-3
"""A smaller error is drawn here."""
_COLUMNS = 3
_PAPER = {"facecolor": "white", "edgecolor": "none", "pad": 1.0, "alpha": 0.75}
"""What lies below a text."""
_TICKS = 5
_LETTERS = 52
"""Letters of a line above a panel."""


def draw_sensitivity(path: Path, campaign: Campaign, played: Sequence[PlayedRun], summary: Summary) -> None:
    """Draw the mean error over each parameter: every run as a dot, the means of the parts with their intervals."""
    columns = min(_COLUMNS, len(campaign.parameters))
    rows = math.ceil(len(campaign.parameters) / columns)
    figure = new_figure(3.3 * rows + 0.9)
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
            panel.set_ylabel("mean |error|, % of span", fontsize=LABEL)
    for spare in range(len(campaign.parameters), rows * columns):
        panels[spare // columns][spare % columns].set_axis_off()
    if laws:
        handles, labels = panels[0][0].get_legend_handles_labels()
        figure.legend(
            handles, labels, frameon=False, ncols=min(len(laws), 9), loc="upper right", fontsize=NORMAL,
            bbox_to_anchor=(1.0, 1.0 - 0.45 / figure.get_figheight()),
        )  # fmt: skip
    height_in = figure.get_figheight()
    head(figure, 0.01, ((f"{campaign.file.title}: effect of each parameter, with 95 % intervals", HEAD, "bold", INK),))
    figure.tight_layout(rect=(0.0, 0.0, 1.0, 1.0 - 0.8 / height_in), h_pad=1.5)
    save(figure, path)


def _color(laws: Sequence[str], law: str) -> str:
    return SERIES[laws.index(law) % len(SERIES)]


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
        where, means, yerr=(below, above), fmt=f"{MARKS[index % len(MARKS)]}-", color=_color(laws, effect.law),
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
    panel.set_xlabel(f"{parameter.name}{scale}", fontsize=NORMAL)
    panel.set_title("\n".join(wrap(text, _LETTERS)), loc="left", fontsize=SMALL, color=INK)
    dress(panel, grid="y")


def draw_corners(
    path: Path, campaign: Campaign, played: Sequence[PlayedRun], corners: Sequence[tuple[PlayedRun, str]]
) -> None:
    """Draw every run as a line through the values of its parameters, and the worst ones with their commands."""
    names = [each.name for each in campaign.parameters]
    height = 4.9 + _ROW_IN * len(corners)
    figure = new_figure(height)
    bottom = (_ROW_IN * len(corners) + 1.1) / height
    panel = figure.add_axes((0.07, bottom, 0.86, 1.0 - bottom - 0.75 / height))
    axis = range(len(names))
    for values in dict.fromkeys(each.run.values for each in played):
        panel.plot(axis, _places(campaign, values), color=FAINT, linewidth=0.6, alpha=0.6, marker=".", zorder=1)
    for number, (corner, command) in enumerate(corners):
        color = SERIES[number % len(SERIES)]
        panel.plot(
            axis, _places(campaign, corner.run.values), color=color, linewidth=2.0,
            marker=MARKS[number % len(MARKS)], zorder=3 + len(corners) - number,
        )  # fmt: skip
        figures = corner.outcome.figures
        found = "failed" if figures is None else f"{figures.worst_mean_abs_error_pct:.2f} %"
        y = (_ROW_IN * (len(corners) - number) - 0.16) / height
        text = f"{_SIGNS[number % len(_SIGNS)]} {corner.run.law}, seed {corner.run.seed}: {found} in the worst dwell"
        figure.text(0.07, y + 0.19 / height, text, color=color, fontsize=NORMAL, fontweight="bold", va="center")
        figure.text(0.085, y, command, color=INK, fontsize=SMALL, family="monospace", va="center")
    for place, parameter in enumerate(campaign.parameters):
        panel.axvline(place, color=MEASURED, linewidth=0.8, zorder=2)
        for value in parameter.range.values or map(parameter.value_at, (0.0, 1.0)):
            panel.annotate(
                shown(value), (place, parameter.place_of(value)), xytext=(7, 0), textcoords="offset points",
                va="center", fontsize=SMALL, annotation_clip=False, zorder=99, bbox=_PAPER,
            )  # fmt: skip
    panel.set_xticks(axis, [_broken(name, len(names)) for name in names], fontsize=SMALL)
    panel.tick_params(axis="x", length=0, pad=14)
    panel.set_yticks([])
    panel.set_ylim(0.0, 1.0)
    panel.set_xlim(-0.3, len(names) - 0.7)
    panel.set_frame_on(False)
    head(figure, 0.01, ((f"{campaign.file.title}: the worst corners", HEAD, "bold", INK),))
    save(figure, path)


def _broken(name: str, count: int) -> str:
    """Return the name of a parameter in lines that are short enough for so many names beside each other."""
    lines = name.replace(".", ".\n")
    return lines.replace("_", "_\n") if count > _FEW_NAMES else lines


_FEW_NAMES = 5
_ROW_IN = 0.46
"""Height of a corner's two lines."""
_SIGNS = ("●", "■", "▲", "▼", "◆", "✚", "✖", "◀", "▶")


def _places(campaign: Campaign, values: Sequence[object]) -> list[float]:
    return [parameter.place_of(value) for parameter, value in zip(campaign.parameters, values, strict=True)]  # type: ignore[arg-type]
