"""The picture of a league: the error of each law on every plant, and its settling against the limit. Pure drawing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from positioner.pictures.colours import FAINT, INK, MARKS, SERIES
from positioner.pictures.panels import HEAD, LABEL, NORMAL, SMALL, dress, head, new_figure
from positioner.studies.conditions import reference_plant

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from positioner.studies.league import LeagueSettings
    from positioner.studies.standings import LawSummary, Standing

_LEAST_SHOWN_PCT = 4e-3
"""A smaller error is drawn here, with its value and an arrow."""
_WHOLE_MS = 100.0
"""Longer times are told without decimals."""
_ROOM = 6.0
"""The end of the axis over the longest time: there stands its number."""
_DECADES_ONLY = 100.0
"""Of a longer axis only the decades have numbers."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LeagueReport:
    """All that the files of a league show; the optimal times are medians of the time-optimal moves, in s.

    They are None where setpoints move.
    """

    settings: LeagueSettings
    summaries: Sequence[LawSummary]
    standings: Sequence[Standing]
    optimal_settle_1pct_s: float | None
    optimal_rest_s: float | None

    @property
    def moves(self) -> bool:
        """Whether the setpoints move."""
        return self.optimal_settle_1pct_s is None


def league_figure(report: LeagueReport) -> Figure:
    """Return the picture: mean error with its interval on every plant, and settling against the limit."""
    settings = report.settings
    plants = list(dict.fromkeys(standing.plant for standing in report.standings))
    laws = [summary.law for summary in report.summaries]
    figure = new_figure(6.6)
    errors, settling = figure.subplots(1, 2, width_ratios=(2.9, 1))
    figure.subplots_adjust(left=0.065, right=0.975, top=0.86, bottom=0.2, wspace=0.36)
    _draw_errors(errors, report, plants, laws)
    _draw_settling(settling, report)
    handles, labels = errors.get_legend_handles_labels()
    figure.legend(
        handles, labels, frameon=False, ncols=min(len(laws), 7), fontsize=NORMAL, loc="lower center",
        bbox_to_anchor=(0.5, 0.0),
    )  # fmt: skip
    seeds = f"{len(settings.seeds)} {'seed' if len(settings.seeds) == 1 else 'seeds'}"
    about = f"{len(laws)} laws, {len(plants)} plants, {seeds} ({', '.join(map(str, settings.seeds))})"
    played = f"setpoints {settings.setpoints}" if report.moves else f"dwells of {settings.dwell_s:g} s"
    title = f"League at {1e-3 / settings.period_s:g} kHz: {about}, {played}"
    head(figure, 0.065, ((title, HEAD, "bold", INK),))
    return figure


def _draw_errors(panel: Axes, report: LeagueReport, plants: list[str], laws: list[str]) -> None:
    for place in range(0, len(plants), 2):
        panel.axvspan(place - 0.5, place + 0.5, color=FAINT, alpha=0.35, linewidth=0.0, zorder=0)
    for index, law in enumerate(laws):
        _draw_law(panel, report, law, index, plants, 0.76 * ((index + 0.5) / len(laws) - 0.5))
    dress(panel, grid="y")
    panel.set_yscale("log")
    panel.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    panel.set_xlim(-0.5, len(plants) - 0.5)
    panel.set_ylim(bottom=0.8 * min(panel.get_ylim()[0], 0.01))
    panel.set_xticks(range(len(plants)), plants, rotation=20, ha="right", rotation_mode="anchor")
    where = "from the moving setpoint" if report.moves else "of the last half second"
    panel.set_ylabel(f"mean |error| {where}, % of span", fontsize=LABEL)
    title = "error" if report.moves else "steady error"
    if len(report.settings.seeds) > 1:
        title += ", with 95 % intervals over the seeds"
    panel.set_title(title, loc="left", fontsize=LABEL, fontweight="bold", color=INK)


def _draw_law(panel: Axes, report: LeagueReport, law: str, index: int, plants: list[str], shift: float) -> None:
    rows = {standing.plant: standing for standing in report.standings if standing.law == law}
    where = [number + shift for number, name in enumerate(plants) if name in rows]
    shown = [rows[name] for name in plants if name in rows]
    means = [max(row.mean_error_pct, _LEAST_SHOWN_PCT) for row in shown]
    lows = [row.mean_error_pct if row.mean_error_low_pct is None else row.mean_error_low_pct for row in shown]
    highs = [row.mean_error_pct if row.mean_error_high_pct is None else row.mean_error_high_pct for row in shown]
    below = [max(mean - max(low, _LEAST_SHOWN_PCT), 0.0) for mean, low in zip(means, lows, strict=True)]
    above = [max(high - mean, 0.0) for mean, high in zip(means, highs, strict=True)]
    panel.errorbar(where, means, yerr=(below, above), label=law, **_look(index))
    for place, row in zip(where, shown, strict=True):
        if row.mean_error_pct < _LEAST_SHOWN_PCT:
            panel.annotate(
                f"{row.mean_error_pct:.0e} ↓", (place, _LEAST_SHOWN_PCT), xytext=(6, -3), textcoords="offset points",
                fontsize=SMALL, color=INK,
            )  # fmt: skip


def _look(index: int) -> dict[str, Any]:
    """Return the look of a law: its place gives mark and colour."""
    mark, colour = MARKS[index % len(MARKS)], SERIES[index % len(SERIES)]
    return {"fmt": mark, "color": colour, "markersize": 6.0, "linewidth": 1.3, "capsize": 2.0}


def _draw_settling(panel: Axes, report: LeagueReport) -> None:
    """Draw the median of each law as a dot, with the quartiles: a bar on a logarithmic axis would begin nowhere."""
    shown = [(place, law) for place, law in enumerate(report.summaries) if law.median_settle_1pct_s]
    farthest_ms = 1e3 * (report.optimal_settle_1pct_s or 0.0)
    for row, (place, law) in enumerate(shown):
        median_ms = (law.median_settle_1pct_s or 0.0) * 1e3
        low_s, high_s = law.settle_quartiles_s
        # of two dwells the quartiles are the later one, and the median lies between
        below, above = (median_ms - 1e3 * low_s if low_s else 0.0, 1e3 * high_s - median_ms if high_s else 0.0)
        reach = [[max(below, 0.0)], [max(above, 0.0)]]
        panel.errorbar([median_ms], [row], xerr=reach, **_look(place))
        told = f"{median_ms:,.{0 if median_ms >= _WHOLE_MS else 1}f}"
        end_ms = max(1e3 * (high_s or 0.0), median_ms)
        panel.annotate(
            told, (end_ms, row), xytext=(5, 0), textcoords="offset points", va="center", fontsize=SMALL, color=INK
        )
        farthest_ms = max(farthest_ms, end_ms)
    limit = ""
    if report.optimal_settle_1pct_s is not None:
        limit_ms = report.optimal_settle_1pct_s * 1e3
        limit = f"\ndashed: optimum, {limit_ms:.1f}"
        panel.axvline(limit_ms, color=INK, linewidth=1.0, linestyle="--", zorder=0)
    dress(panel, grid="x")
    panel.set_xscale("log")
    if farthest_ms:
        panel.set_xlim(right=_ROOM * farthest_ms)
    low_ms, high_ms = panel.get_xlim()
    panel.xaxis.set_major_locator(LogLocator(subs=(1.0,) if high_ms > _DECADES_ONLY * low_ms else (1.0, 2.0, 5.0)))
    panel.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    panel.xaxis.set_minor_formatter(NullFormatter())
    panel.set_yticks(range(len(shown)), [law.law for _, law in shown])
    panel.set_ylim(len(shown) - 0.4, -0.8)
    panel.set_xlabel(f"settling to 1 %, ms: quartiles{limit}", fontsize=LABEL)
    plant = reference_plant(report.settings.plants)
    panel.set_title(f"speed, {plant}", loc="left", fontsize=LABEL, fontweight="bold", color=INK)
