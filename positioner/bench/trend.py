"""The picture of a run, `trend.png`: position, current, speed and the growth of the table over one time axis.

Shell, because it writes a file. Figure and canvas are local objects: no global state of matplotlib is used, and no
display is needed. Lines differ in lightness as well as in hue (Okabe and Ito's palette), so that the picture can be
read without colour vision, and in print.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from positioner.bench.curves import MOST_POINTS, envelope
from positioner.bench.modes import ACTIVE_AT_LEAST, active_fraction, in_words, mode_lines, name_of
from positioner.bench.panels import fit, line, name
from positioner.bench.reasons import Reasons, draw_reasons
from positioner.valve.stiction import Quantity
from positioner.wire.messages import Mode

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from positioner.bench.metrics import DwellMetrics, Totals
    from positioner.bench.modes import ModeSpan
    from positioner.bench.scenario import Scenario


MOST_DWELL_LABELS = 12
"""Most dwells that are all labelled with number and error; of more dwells every second, third, … is labelled."""

NARROWEST_LABEL = 0.012
"""Part of the run that a mode must last so that there is room for its name."""

_TRUE, _ESTIMATED, _SETPOINT = "#0072B2", "#56B4E9", "#D55E00"
_LOWER, _UPPER, _MEASURED = "#009E73", "#E69F00", "#8A8A8A"
_STICK, _SLIP, _LANDING = "#0072B2", "#D55E00", "#009E73"
_INK, _FAINT = "#222222", "#D9D9D9"
_SHADES: dict[Mode | None, str] = {Mode.HOLD: "#E69F00", Mode.FAILSAFE: "#D55E00", None: "#CC79A7"}
_IDLE = "#B0B0B0"


@dataclass(frozen=True, slots=True, kw_only=True)
class TrendData:
    """The data of the picture; arrays have one value for each sample, shape (n,), unless noted.

    A bound is NaN where it is not active, and None if the law has no such bound.
    """

    scenario: Scenario
    span_m: float
    dwells: tuple[DwellMetrics, ...]
    totals: Totals
    time_s: NDArray[np.float64]
    modes: Sequence[ModeSpan]
    position_m: NDArray[np.float64]
    """True position."""
    measured_m: NDArray[np.float64] | None
    setpoint_m: NDArray[np.float64]
    current_ma: NDArray[np.float64]
    current_lower_ma: NDArray[np.float64] | None
    current_upper_ma: NDArray[np.float64] | None
    velocity_m_per_s: NDArray[np.float64]
    """True velocity."""
    velocity_estimate_m_per_s: NDArray[np.float64] | None
    velocity_lower_m_per_s: NDArray[np.float64] | None
    velocity_upper_m_per_s: NDArray[np.float64] | None
    learned_s: Mapping[Quantity, NDArray[np.float64]]
    """Instants at which the table learned a value of each quantity, shape (any,)."""
    why: Reasons = field(default_factory=Reasons)


def draw_trend(path: Path, data: TrendData) -> None:
    """Write the picture of `data` to `path`: a PNG of 1600 by 1200 pixels."""
    figure = Figure(figsize=(16, 12), dpi=100, facecolor="white")
    FigureCanvasAgg(figure)
    panels = figure.subplots(4, 1, sharex=True, height_ratios=(3.4, 2.0, 2.0, 1.4))
    figure.subplots_adjust(left=0.065, right=0.872, top=0.885, bottom=0.055, hspace=0.09)

    for panel in panels:
        _prepare(panel, data)
    _draw_position(panels[0], data)
    _draw_current(panels[1], data)
    _draw_speed(panels[2], data)
    _draw_table(panels[3], data)
    _label_dwells(panels[0], data)
    panels[-1].set_xlabel("time, s", fontsize=13)
    panels[-1].set_xlim(0.0, data.scenario.duration_s)
    figure.align_ylabels(panels)
    _head(figure, 0.957, title(data.scenario), size=18.0, weight="bold")
    in_control = active_fraction(data.modes) >= ACTIVE_AT_LEAST
    text = headline(data.totals) if in_control else f"{mode_lines(data.modes)[0]}  ·  {headline(data.totals)}"
    _head(figure, 0.930, text, size=13.0, weight="normal", color=_INK if in_control else _SETPOINT)
    figure.savefig(path)


def title(scenario: Scenario) -> str:
    """Return the title: scenario, law, seed and period."""
    period = f"{scenario.sample_period_s * 1e3:g} ms"
    return f"{scenario.name}: {scenario.title}  |  law {scenario.law}, seed {scenario.seed}, period {period}"


def headline(totals: Totals) -> str:
    """Return the figures of the run that matter most, in one line."""
    median_s = totals.median_settle_1pct_s
    settling = "never" if median_s is None else f"{median_s * 1e3:.1f} ms"
    stragglers = f", {totals.unsettled_1pct} of {totals.dwells} never" if totals.unsettled_1pct else ""
    travel = "" if totals.travel_ratio is None else f"  ·  travel {totals.travel_ratio:.2f} times the shortest"
    return (
        f"error {totals.mean_abs_error_pct:.2f} % of span, worst dwell {totals.worst_mean_abs_error_pct:.2f} %"
        f"  ·  settling to 1 % {settling} (median{stragglers})"
        f"  ·  limit cycles {totals.limit_cycles} of {totals.dwells}{travel}"
    )


def _head(figure: Figure, bottom: float, text: str, *, size: float, weight: str, color: str = _INK) -> None:
    line = figure.text(0.065, bottom, text, fontsize=size, fontweight=weight, color=color)
    room = 0.925 * figure.bbox.width
    line.set_fontsize(size * min(1.0, room / line.get_window_extent().width))


def _prepare(panel: Axes, data: TrendData) -> None:
    panel.spines[["top", "right"]].set_visible(False)
    panel.spines[["left", "bottom"]].set_color(_MEASURED)
    panel.tick_params(colors=_INK, labelsize=11)
    panel.margins(x=0.0)
    for edge_s in data.scenario.dwell_edges_s[1:-1]:
        panel.axvline(edge_s, color=_FAINT, linewidth=0.8, zorder=0)
    for span in data.modes:
        if span.mode is not Mode.ACTIVE:
            shade = _SHADES.get(span.mode, _IDLE)
            panel.axvspan(span.begin_s, span.end_s, color=shade, alpha=0.18, linewidth=0.8, zorder=0)


def _draw_position(panel: Axes, data: TrendData) -> None:
    setpoint_mm, position_mm, band_mm = data.setpoint_m * 1e3, data.position_m * 1e3, 0.01 * data.span_m * 1e3
    if data.measured_m is not None:
        # every n-th sample and no envelope: the density of the points shows the distribution of the noise
        stride = -(-len(data.time_s) // MOST_POINTS)
        dots = (data.time_s[::stride], data.measured_m[::stride] * 1e3)
        panel.plot(*dots, ".", color=_MEASURED, alpha=0.45, markersize=2.6, markeredgewidth=0.0, zorder=1)
    time_s, thin_mm = envelope(data.time_s, setpoint_mm)
    panel.fill_between(
        time_s, thin_mm - band_mm, thin_mm + band_mm, step="post", color=_SETPOINT, alpha=0.18, linewidth=0.0, zorder=2
    )
    line(panel, data.time_s, setpoint_mm, _SETPOINT, width=1.0, zorder=3)
    line(panel, data.time_s, position_mm, _TRUE, width=1.3)
    fit(panel, [setpoint_mm, position_mm], (1.0, 99.0))
    panel.set_ylabel("position, mm", fontsize=13)
    names = [("true", _TRUE), ("setpoint, ±1 % span", _SETPOINT), ("measured", _MEASURED)]
    name(panel, names if data.measured_m is not None else names[:2])
    for span in data.modes:
        if not span.is_normal and span.duration_s > NARROWEST_LABEL * data.scenario.duration_s:
            panel.annotate(
                f"{name_of(span.mode)}: {in_words(span.cause)}", (span.begin_s, 0.02),
                xycoords=("data", "axes fraction"), xytext=(3, 0),
                textcoords="offset points", rotation=90, fontsize=9, color=_INK, va="bottom",
            )  # fmt: skip


def _draw_current(panel: Axes, data: TrendData) -> None:
    bounds = (
        (data.current_upper_ma, "upper bound", _UPPER),
        (data.current_lower_ma, "lower bound", _LOWER),
    )
    _draw_with_bounds(panel, data.time_s, (data.current_ma, "command"), bounds)
    draw_reasons(panel, data.why, 1 + sum(curve is not None for curve, _, _ in bounds))
    fit(panel, [data.current_ma], (0.0, 100.0))
    panel.set_ylabel("current, mA", fontsize=13)


def _draw_speed(panel: Axes, data: TrendData) -> None:
    others = (
        (data.velocity_estimate_m_per_s, "estimated", _ESTIMATED),
        (data.velocity_upper_m_per_s, "upper bound", _UPPER),
        (data.velocity_lower_m_per_s, "lower bound", _LOWER),
    )
    _draw_with_bounds(panel, data.time_s, (data.velocity_m_per_s, "true"), others)
    # a bound is far from the speed when the error is large: the speed decides the limits of the panel
    fit(panel, [data.velocity_m_per_s], (0.05, 99.95))
    panel.set_ylabel("speed, m/s", fontsize=13)


def _draw_with_bounds(
    panel: Axes,
    time_s: NDArray[np.float64],
    curve: tuple[NDArray[np.float64], str],
    others: tuple[tuple[NDArray[np.float64] | None, str, str], ...],
) -> None:
    """Draw a thin curve over broad pale ones, which stay visible where they coincide; None is not drawn."""
    values, first = curve
    line(panel, time_s, values, _TRUE, width=1.2)
    names = [(first, _TRUE)]
    for other, label, colour in others:
        if other is not None:
            line(panel, time_s, other, colour, width=3.0, alpha=0.55, zorder=3.0)
            names.append((label, colour))
    name(panel, names)


def _draw_table(panel: Axes, data: TrendData) -> None:
    kinds = (
        (data.learned_s[Quantity.BREAKAWAY_CURRENT], "breakaways", _SLIP),
        (data.learned_s[Quantity.STICK_SPEED], "stick speeds", _STICK),
        (data.learned_s[Quantity.LANDING_BIAS], "landings", _LANDING),
    )
    # stacked, because equal counts would hide each other: the top edge is the total number of learned samples
    when_s = np.unique(np.concatenate(([0.0, data.scenario.duration_s], *data.learned_s.values())))
    below = np.zeros(len(when_s))
    for learned_s, _, colour in kinds:
        above = below + np.searchsorted(np.sort(learned_s), when_s, side="right")
        panel.fill_between(when_s, below, above, step="post", color=colour, alpha=0.65, linewidth=0.0)
        below = above
    names = [(f"{len(learned_s)} {label}", colour) for learned_s, label, colour in reversed(kinds)]
    panel.set_ylim(0.0, 1.1 * max(below[-1], 1.0))
    panel.yaxis.set_major_locator(MaxNLocator(4, integer=True))
    panel.set_ylabel("learned samples", fontsize=13)
    name(panel, names)


def _label_dwells(panel: Axes, data: TrendData) -> None:
    every = -(-len(data.dwells) // MOST_DWELL_LABELS)
    edges_s = data.scenario.dwell_edges_s
    panel.annotate("dwell: mean error", (1.008, 1.015), xycoords="axes fraction", va="bottom", fontsize=11, color=_INK)
    for index, dwell in enumerate(data.dwells):
        if index % every == 0:
            bad = dwell.limit_cycle or dwell.settle_1pct_s is None
            panel.annotate(
                f"{index + 1}:  {dwell.mean_abs_error_pct:.2f} %",
                ((edges_s[index] + edges_s[index + 1]) / 2.0, 1.015), xycoords=("data", "axes fraction"),
                ha="center", va="bottom", fontsize=11,
                color=_SETPOINT if bad else _INK, fontweight="bold" if bad else "normal",
            )  # fmt: skip
