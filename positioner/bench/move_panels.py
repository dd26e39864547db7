"""The three panels of one move: position, speed and current over milliseconds. Pure drawing."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.ticker import MaxNLocator

from positioner.bench.mode_bands import bands_of
from positioner.pictures.bands import Band, draw_bands
from positioner.pictures.colours import BELIEF, BOUND, BREAKAWAY, COMMAND, FAINT, INK, MEASURED, POSITION, SETPOINT
from positioner.pictures.panels import LABEL, NORMAL, dress

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from positioner.bench.moves import Breakaway, MovesData, Window
    from positioner.bench.trend import TrendData

    Array = NDArray[np.float64]

PREDICTED, DASH_DOT = (0, (3, 1.6)), (0, (6, 2, 1, 2))
"""The dashes of a prediction and of Γ."""
_FEW, _MANY = 60, 4000
"""Samples of a window: below, dots are large; above, they are rasterised."""


def draw_move(panels: Sequence[Axes], data: MovesData, window: Window, predicted: Array, *, names: bool) -> None:
    """Draw a move; with `names` the panels carry the names of their quantities."""
    trend = data.trend
    part = slice(window.first, window.last + 1)
    begun_s = float(trend.time_s[window.begin])
    time_ms = (trend.time_s[part] - begun_s) * 1e3
    for panel in panels:
        dress(panel, grid="y")
        panel.yaxis.set_major_locator(MaxNLocator(5, steps=(1, 2, 5, 10), prune="both"))
    position, speed, current = panels
    _draw_position(position, trend, part, time_ms)
    position.plot(
        time_ms, predicted * 1e3, color=BELIEF, linewidth=2.0, linestyle=PREDICTED,
        zorder=5.0,
    )  # fmt: skip
    _draw_speed(speed, trend, part, time_ms)
    breakaway = _breakaway_of(data, window)
    _draw_current(current, trend, part, time_ms, breakaway)
    position.set_xlim(time_ms[0], time_ms[-1])
    position.xaxis.set_major_locator(MaxNLocator(6, steps=(1, 2, 5, 10), prune="both"))
    for panel in panels[:-1]:
        panel.tick_params(labelbottom=False)
    bands = [
        Band((each.begin - begun_s) * 1e3, (each.end - begun_s) * 1e3, each.mode, each.words)
        for each in bands_of(trend.modes)
        if each.end >= trend.time_s[window.first] and each.begin <= trend.time_s[window.last]
    ]
    draw_bands(panels, bands, float(time_ms[0]), float(time_ms[-1]))
    position.set_xlim(time_ms[0], time_ms[-1])
    if names:
        for panel, label in zip(panels, ("position, mm", "speed, m/s", "current, mA"), strict=True):
            panel.set_ylabel(label, fontsize=LABEL)
    position.set_title(_heading(data, window, breakaway), loc="left", fontsize=NORMAL, color=INK)


def _heading(data: MovesData, window: Window, breakaway: Breakaway | None) -> str:
    trend = data.trend
    first, last = trend.position_m[window.begin] * 1e3, trend.position_m[window.end] * 1e3
    lasts_ms = (trend.time_s[window.end] - trend.time_s[window.begin]) * 1e3
    text = f"{trend.time_s[window.begin]:.3f} s: {first:.1f} to {last:.1f} mm in {lasts_ms:.3g} ms"
    return text if breakaway is None else f"{text}\nΓ {breakaway.current_ma:.2f} mA"


def _breakaway_of(data: MovesData, window: Window) -> Breakaway | None:
    """Return the last Γ before the stem stopped, where it began this move and none before it."""
    end_s = data.trend.time_s[window.end]
    before_s = max((data.trend.time_s[each.end] for each in data.shown if each.last < window.begin), default=-1.0)
    known = [each for each in data.breakaways if before_s < each.begun_s <= end_s]
    return known[-1] if known else None


def _draw_position(panel: Axes, trend: TrendData, part: slice, time_ms: Array) -> None:
    setpoint_mm, band_mm = trend.setpoint_m[part] * 1e3, 0.01 * trend.span_m * 1e3
    panel.fill_between(
        time_ms, setpoint_mm - band_mm, setpoint_mm + band_mm, step="post", color=FAINT, alpha=0.7, linewidth=0.0,
        zorder=0.8,
    )  # fmt: skip
    panel.plot(time_ms, setpoint_mm, color=SETPOINT, linewidth=1.0, drawstyle="steps-post", zorder=3.0)
    few = len(time_ms) <= _FEW
    if trend.measured_m is not None:
        panel.plot(
            time_ms, trend.measured_m[part] * 1e3, ".", color=MEASURED, markersize=7.0 if few else 3.0,
            markeredgewidth=0.0, zorder=1.0, rasterized=len(time_ms) > _MANY,
        )  # fmt: skip
    panel.plot(time_ms, trend.position_m[part] * 1e3, color=POSITION, linewidth=2.0, zorder=4.0)
    shown_mm = np.concatenate((trend.position_m[part] * 1e3, [setpoint_mm[-1]]))
    low, high = float(shown_mm.min()), float(shown_mm.max())
    margin = max(0.14 * (high - low), 0.5 * band_mm)
    panel.set_ylim(low - margin, high + margin)


def _draw_speed(panel: Axes, trend: TrendData, part: slice, time_ms: Array) -> None:
    speed = trend.velocity_m_per_s[part]
    panel.plot(time_ms, speed, color=POSITION, linewidth=1.8, zorder=4.0)
    if trend.velocity_estimate_m_per_s is not None:
        panel.plot(
            time_ms, trend.velocity_estimate_m_per_s[part], color=BELIEF, linewidth=1.8, linestyle=PREDICTED,
            zorder=5.0,
        )  # fmt: skip
    for bound in (trend.velocity_lower_m_per_s, trend.velocity_upper_m_per_s):
        _bound(panel, time_ms, bound, part)
    low, high = min(float(speed.min()), 0.0), max(float(speed.max()), 0.0)
    panel.set_ylim(low - 0.25 * (high - low), high + 0.25 * (high - low))


def _draw_current(panel: Axes, trend: TrendData, part: slice, time_ms: Array, breakaway: Breakaway | None) -> None:
    current_ma = trend.current_ma[part]
    for bound in (trend.current_lower_ma, trend.current_upper_ma):
        _bound(panel, time_ms, bound, part)
    shown = current_ma
    if breakaway is not None:
        panel.axhline(breakaway.current_ma, color=BREAKAWAY, linewidth=1.6, linestyle=DASH_DOT, zorder=3.0)
        shown = np.append(current_ma, breakaway.current_ma)
    panel.plot(time_ms, current_ma, color=COMMAND, linewidth=1.6, drawstyle="steps-post", zorder=4.0)
    low, high = float(np.nanmin(shown)), float(np.nanmax(shown))
    margin = 0.12 * (high - low) or 1.0
    panel.set_ylim(low - margin, high + margin)


def _bound(panel: Axes, time_ms: Array, bound: Array | None, part: slice) -> None:
    """Draw a level for each sample in which the bound is active; a law that rests has a bound of 0, which is none."""
    if bound is None:
        return
    own, end_ms = bound[part], np.append(time_ms[1:], time_ms[-1])
    active = np.isfinite(own) & (own != 0.0)
    panel.hlines(own[active], time_ms[active], end_ms[active], color=BOUND, linewidth=2.6, alpha=0.8, zorder=2.5)
