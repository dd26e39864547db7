"""The picture of a run, `trend.png`: position, current, speed and the growth of the table over one time axis.

Shell, because it writes a file. `moves.png` shows single moves, which are too short for this axis.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.ticker import MaxNLocator

from positioner.bench.mode_bands import bands_of
from positioner.bench.modes import ACTIVE_AT_LEAST, active_fraction, mode_lines
from positioner.bench.reasons import Reasons, draw_reasons
from positioner.pictures.bands import draw_bands
from positioner.pictures.colours import (
    BELIEF,
    BOUND,
    COMMAND,
    FAINT,
    FALLBACK,
    INK,
    MEASURED,
    POSITION,
    SETPOINT,
    TABLE,
    shade_of,
)
from positioner.pictures.curves import envelope
from positioner.pictures.files import save
from positioner.pictures.panels import (
    BLOCK,
    DOT,
    HEAD,
    LABEL,
    LINE,
    NORMAL,
    SMALL,
    dress,
    fit,
    head,
    line,
    name,
    new_figure,
)
from positioner.valve.stiction import Quantity

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from positioner.bench.metrics import DwellMetrics, Totals
    from positioner.bench.modes import ModeSpan
    from positioner.bench.scenario import Scenario


MOST_DWELL_LABELS = 12
"""Most dwells that are all labelled with number and error; of more dwells every second, third, … is labelled."""
_MOST_DOTS = 20_000
_LEFT, _RIGHT = 0.065, 0.865


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
    """Write the picture of `data` to `path`, a PNG of 1600 by 1200 pixels, and as SVG beside it."""
    save(trend_figure(data), path)


def trend_figure(data: TrendData) -> Figure:
    """Return the picture of `data`."""
    figure = new_figure(9.375)
    panels = figure.subplots(4, 1, sharex=True, height_ratios=(3.4, 2.0, 2.0, 1.4))
    figure.subplots_adjust(left=_LEFT, right=_RIGHT, top=0.885, bottom=0.06, hspace=0.09)
    for panel in panels:
        dress(panel)
        panel.margins(x=0.0)
        # without ticks at the edges, where those of the next panel are
        panel.yaxis.set_major_locator(MaxNLocator(7, steps=(1, 2, 5, 10), prune="both"))
        for edge_s in data.scenario.dwell_edges_s[1:-1]:
            panel.axvline(edge_s, color=FAINT, linewidth=0.8, zorder=0.5)
    _draw_position(panels[0], data)
    _draw_current(panels[1], data)
    _draw_speed(panels[2], data)
    _draw_table(panels[3], data)
    _label_dwells(panels[0], data)
    draw_bands(panels, bands_of(data.modes), 0.0, data.scenario.duration_s)
    panels[-1].set_xlabel("time, s", fontsize=LABEL)
    panels[-1].set_xlim(0.0, data.scenario.duration_s)
    figure.align_ylabels(panels)
    in_control = active_fraction(data.modes) >= ACTIVE_AT_LEAST
    text = headline(data.totals) if in_control else f"{mode_lines(data.modes)[0]}  ·  {headline(data.totals)}"
    ink = INK if in_control else FALLBACK
    head(figure, _LEFT, ((title(data.scenario), HEAD, "bold", INK), (text, LABEL, "normal", ink)))
    return figure


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


def _draw_position(panel: Axes, data: TrendData) -> None:
    setpoint_mm, position_mm, band_mm = data.setpoint_m * 1e3, data.position_m * 1e3, 0.01 * data.span_m * 1e3
    names = [(LINE, POSITION, "true"), (LINE, SETPOINT, "setpoint"), (BLOCK, FAINT, "± 1 % of span")]
    if data.measured_m is not None:
        # every n-th sample and no envelope: the density of the points shows the distribution of the noise
        stride = -(-len(data.time_s) // _MOST_DOTS)
        dots = (data.time_s[::stride], data.measured_m[::stride] * 1e3)
        panel.plot(
            *dots, ".", color=MEASURED, alpha=0.45, markersize=2.2, markeredgewidth=0.0, zorder=1, rasterized=True
        )
        names.append((DOT, MEASURED, "measured"))
    time_s, thin_mm = envelope(data.time_s, setpoint_mm)
    panel.fill_between(
        time_s, thin_mm - band_mm, thin_mm + band_mm, step="post", color=FAINT, alpha=0.7, linewidth=0.0, zorder=0.8
    )
    line(panel, data.time_s, setpoint_mm, SETPOINT, width=0.9, zorder=3)
    line(panel, data.time_s, position_mm, POSITION, width=1.4)
    fit(panel, [setpoint_mm, position_mm], (1.0, 99.0))
    panel.set_ylabel("position, mm", fontsize=LABEL)
    # a band may be too near to another one to carry its name
    kinds = Counter(band.mode for band in bands_of(data.modes) if band.notable)
    name(panel, [*names, *((BLOCK, shade_of(mode), f"{mode}, {times} ×") for mode, times in kinds.items())])


def _draw_current(panel: Axes, data: TrendData) -> None:
    bounds = (data.current_lower_ma, data.current_upper_ma)
    line(panel, data.time_s, data.current_ma, COMMAND, width=1.1)
    names = [(LINE, COMMAND, "command"), *_draw_bounds(panel, data.time_s, bounds)]
    name(panel, names)
    draw_reasons(panel, data.why, len(names))
    fit(panel, [data.current_ma], (0.0, 100.0))
    panel.set_ylabel("current, mA", fontsize=LABEL)


def _draw_speed(panel: Axes, data: TrendData) -> None:
    bounds = (data.velocity_lower_m_per_s, data.velocity_upper_m_per_s)
    line(panel, data.time_s, data.velocity_m_per_s, POSITION, width=1.1)
    names = [(LINE, POSITION, "true")]
    if data.velocity_estimate_m_per_s is not None:
        line(panel, data.time_s, data.velocity_estimate_m_per_s, BELIEF, width=2.6, alpha=0.7, zorder=3.0)
        names.append((LINE, BELIEF, "the law's estimate"))
    name(panel, [*names, *_draw_bounds(panel, data.time_s, bounds)])
    # a bound is far from the speed when the error is large: the speed decides the limits of the panel
    fit(panel, [data.velocity_m_per_s], (0.05, 99.95))
    panel.set_ylabel("speed, m/s", fontsize=LABEL)


def _draw_bounds(
    panel: Axes, time_s: NDArray[np.float64], bounds: Sequence[NDArray[np.float64] | None]
) -> list[tuple[str, str, str]]:
    """Draw the bounds that there are, broad and pale below the curve, and return their name."""
    active = [bound for bound in bounds if bound is not None]
    for bound in active:
        line(panel, time_s, bound, BOUND, width=2.6, alpha=0.6, zorder=2.9)
    return [(LINE, BOUND, "bounds, where active")] if active else []


def _draw_table(panel: Axes, data: TrendData) -> None:
    kinds = (
        (data.learned_s[Quantity.BREAKAWAY_CURRENT], "breakaways", TABLE[0]),
        (data.learned_s[Quantity.STICK_SPEED], "stick speeds", TABLE[1]),
        (data.learned_s[Quantity.LANDING_BIAS], "landings", TABLE[2]),
    )
    # stacked, because equal counts would hide each other: the top edge is the total number of learned samples
    when_s = np.unique(np.concatenate(([0.0, data.scenario.duration_s], *data.learned_s.values())))
    below = np.zeros(len(when_s))
    for learned_s, _, colour in kinds:
        above = below + np.searchsorted(np.sort(learned_s), when_s, side="right")
        panel.fill_between(when_s, below, above, step="post", color=colour, linewidth=0.0)
        below = above
    panel.set_ylim(0.0, 1.1 * max(below[-1], 1.0))
    panel.yaxis.set_major_locator(MaxNLocator(4, integer=True, prune="upper"))
    panel.set_ylabel("learned samples", fontsize=LABEL)
    name(panel, [(BLOCK, colour, f"{len(learned_s)} {label}") for learned_s, label, colour in reversed(kinds)])


def _label_dwells(panel: Axes, data: TrendData) -> None:
    every = -(-len(data.dwells) // MOST_DWELL_LABELS)
    edges_s = data.scenario.dwell_edges_s
    panel.annotate(
        "dwell: mean error", (1.008, 1.015), xycoords="axes fraction", va="bottom", fontsize=SMALL, color=INK
    )
    for index, dwell in enumerate(data.dwells):
        if index % every == 0:
            bad = dwell.limit_cycle or dwell.settle_1pct_s is None
            panel.annotate(
                f"{index + 1}:  {dwell.mean_abs_error_pct:.2f} %",
                ((edges_s[index] + edges_s[index + 1]) / 2.0, 1.015), xycoords=("data", "axes fraction"),
                ha="center", va="bottom", fontsize=NORMAL,
                color=FALLBACK if bad else INK, fontweight="bold" if bad else "normal",
            )  # fmt: skip
