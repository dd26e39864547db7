"""The picture of an identification: the signature, the breakaways, and the steps with their fit. Shell."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from positioner.commissioning.explained import BREAKAWAYS, STEPS, STROKES
from positioner.commissioning.played import played_steps
from positioner.commissioning.record import Kind
from positioner.pictures.colours import BELIEF, BREAKAWAY, INK, REFERENCE, SERIES, TABLE
from positioner.pictures.files import save
from positioner.pictures.panels import HEAD, LABEL, NORMAL, dress, head, new_figure

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from matplotlib.axes import Axes

    from positioner.commissioning.explained import Part
    from positioner.commissioning.identified import IdentifiedValve
    from positioner.commissioning.record import Stretch
    from positioner.config.schema import Configuration

_AFTER_S = 0.4


def draw(path: Path, stretches: Sequence[Stretch], found: IdentifiedValve, configuration: Configuration) -> None:
    """Draw into `path`."""
    figure = new_figure(8.2)
    (left, middle, right), below = figure.subplots(2, 3)
    figure.subplots_adjust(left=0.06, right=0.985, top=0.9, bottom=0.07, wspace=0.24, hspace=0.32)
    for axes, kind in zip(below, (STROKES, BREAKAWAYS, STEPS), strict=True):
        _residuals(axes, kind, [each for each in found.parts if each.kind == kind])
    valve, period_s = found.laid_over(configuration.valve), configuration.control.sample_period_s
    gain = valve.force_gain_n_per_ma
    for number, each in enumerate(one for one in stretches if one.kind is Kind.STROKE):
        label = f"{each.rate_ma_per_s:g} mA/s" if number % 2 == 0 else None
        colour = SERIES[number // 2 % len(SERIES)]
        left.plot(each.applied_ma, np.asarray(each.measured_m) * 1e3, color=colour, lw=1.0, label=label)
    position_m = np.linspace(*valve.reach_m(configuration.guard.current_low_ma, configuration.guard.current_high_ma))
    for side in (-1.0, 0.0, 1.0):
        force_n = valve.spring_rate_n_per_m * position_m + valve.bench_set_n + side * valve.coulomb_friction_n
        left.plot(force_n / gain, position_m * 1e3, color=BELIEF, ls="--" if side else ":", lw=1.6)
    _label(left, "Signature; dashed: spring ± sliding friction", "current, mA", "position, mm")
    left.legend(fontsize=NORMAL, frameon=False)
    _breakaways(middle, stretches, found, gain)
    for number, (each, modelled_m) in enumerate(played_steps(stretches, valve, period_s)):
        end = min(each.slip + round(_AFTER_S / period_s), len(each.measured_m))
        time_ms = (np.arange(each.held, end) - each.held) * period_s * 1e3
        rest_m = float(np.nanmean(each.measured_m[each.held // 4 : each.held]))
        colour = SERIES[number % len(SERIES)]
        readings_mm = (np.asarray(each.measured_m[each.held : end]) - rest_m) * 1e3
        right.plot(time_ms, readings_mm, ".", color=colour, ms=2.5, rasterized=True)
        right.plot(time_ms, (modelled_m[each.held : end] - rest_m) * 1e3, color=colour, lw=1.2)
    _label(right, "Steps: readings (dots), the fitted valve (lines)", "time after the step, ms", "way, mm")
    head(figure, 0.06, ((f"{valve.id}: identification", HEAD, "bold", INK),))
    save(figure, path)


def _residuals(axes: Axes, kind: str, parts: Sequence[Part]) -> None:
    named: set[float] = set()
    for each in parts:
        along, off_m = np.asarray(each.curve).T
        colour = SERIES[0] if each.direction > 0.0 else SERIES[1]
        label = None if each.direction in named else "opening" if each.direction > 0.0 else "closing"
        axes.plot(along * 1e3, off_m * 1e3, ".-", color=colour, lw=1.0, ms=3.0, label=label)
        named.add(each.direction)
    if parts:
        most_mm = 1e3 * min(each.most_m for each in parts)
        axes.axhspan(-most_mm, most_mm, facecolor=REFERENCE, alpha=0.15, label="explained", zorder=0)
        axes.legend(fontsize=NORMAL, frameon=False)
    words = "position, mm" if kind == STROKES else "time after the slip was seen, ms"
    _label(axes, f"Readings beside the fitted valve: {kind}", words, "mm")


def _label(axes: Axes, title: str, x_label: str, y_label: str) -> None:
    dress(axes)
    axes.set_title(title, loc="left", fontsize=NORMAL, color=INK)
    axes.set_xlabel(x_label, fontsize=LABEL)
    axes.set_ylabel(y_label, fontsize=LABEL)


def _breakaways(axes: Axes, stretches: Sequence[Stretch], found: IdentifiedValve, gain: float) -> None:
    slips = [each for each in stretches if each.kind is Kind.BREAKAWAY]
    place_mm = [1e3 * float(np.nanmean(each.measured_m[each.held // 4 : each.held])) for each in slips]
    spring, preload = found.spring_rate_n_per_m.value, found.bench_set_n.value
    force_n = [
        each.direction * (gain * each.applied_ma[each.slip - 1] - preload - spring * place * 1e-3)
        for each, place in zip(slips, place_mm, strict=True)
    ]
    for direction, mark, name, inside in ((1.0, "^", "opening", BREAKAWAY), (-1.0, "v", "closing", "white")):
        chosen = [number for number, each in enumerate(slips) if each.direction == direction]
        axes.plot(
            [place_mm[number] for number in chosen], [force_n[number] for number in chosen], mark, ms=7.0,
            color=BREAKAWAY, markerfacecolor=inside, label=name,
        )  # fmt: skip
    for interval, colour, name in (
        (found.static_friction_n, TABLE[1], "static friction, 95 %"),
        (found.coulomb_friction_n, REFERENCE, "sliding friction, 95 %"),
    ):
        # the edge keeps a narrow one visible
        axes.axhspan(interval.low, interval.high, facecolor=colour, edgecolor=colour, lw=1.5, label=name, zorder=0)
    _label(axes, "Force when a slip was seen, lag included", "position, mm", "force, N")
    axes.legend(fontsize=NORMAL, frameon=False)
