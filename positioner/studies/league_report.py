"""The files of a league: `league.json`, `league.md` and `league.png`. Shell, because it writes files."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from positioner.doctor.bus_load import REFUSE_ABOVE, bus_load, in_words
from positioner.studies.conditions import reference_plant
from positioner.studies.markdown import table
from positioner.wire.codec import make_codec

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from matplotlib.axes import Axes

    from positioner.studies.league import LeagueSettings
    from positioner.studies.standings import LawSummary, Standing

_PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#999999", "#8B5E3C")
_MARKS = ("o", "s", "^", "v", "D", "P", "X", "<", ">")
_INTERVALS = (
    "In parentheses: 95 % percentile bootstrap over the means of {} seeds, because the dwells of one run correlate; "
    "with few seeds the interval is hardly more than their range."
)
_LEAST_SHOWN_PCT = 4e-3
"""A smaller error is drawn here, with its value and an arrow."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LeagueReport:
    """All that the files of a league show; the optimal times are medians of the time-optimal moves, in s."""

    settings: LeagueSettings
    summaries: Sequence[LawSummary]
    standings: Sequence[Standing]
    optimal_settle_1pct_s: float
    optimal_rest_s: float


def write_report(folder: Path, report: LeagueReport) -> None:
    """Write the three files into `folder`."""
    (folder / "league.json").write_text(json.dumps(asdict(report), indent=2) + "\n", encoding="utf-8")
    (folder / "league.md").write_text(to_markdown(report), encoding="utf-8")
    draw_league(folder / "league.png", report)


def to_markdown(report: LeagueReport) -> str:
    """Return the standings as two Markdown tables: the laws over all plants, and each law on each plant."""
    figures = (
        f"{reference_plant(report.settings.plants)}, %",
        "worst plant, %",
        "worst dwell, %",
        "limit cycles",
        "unsettled",
        "settles to 1 %, ms",
    )
    head = ("law", *figures, "× limit", "travel / ideal", "× nmpc")
    limit = f"{_ms(report.optimal_settle_1pct_s)} (rests after {_ms(report.optimal_rest_s)})"
    rows = [
        *(_law_cells(law) for law in report.summaries),
        ("time-optimal limit", "–", "–", "–", "–", "–", limit, "1.00", "1.00", "–"),
    ]
    lines = [*table(head, rows), ""]
    plants = list(dict.fromkeys(standing.plant for standing in report.standings))
    seeds = len(report.settings.seeds)
    heading = "mean error, %" if seeds == 1 else "mean error, % (95 %)"
    cells = {(row.law, row.plant): _interval(row) for row in report.standings}
    rows = [(f"`{law.law}`", *(cells[law.law, plant] for plant in plants)) for law in report.summaries]
    lines += table((heading, *plants), rows)
    lines += ["", "A single seed: no interval."] if seeds == 1 else ["", _INTERVALS.format(seeds)]
    return "\n".join(lines + _caveat(report.settings.period_s)) + "\n"


def _caveat(period_s: float) -> list[str]:
    """Return a warning where no classic bus carries frames at this period."""
    load = bus_load(make_codec(), period_s, 1_000_000)
    if load.total <= REFUSE_ABOVE:
        return []
    return ["", f"Simulation only: at {period_s * 1e3:g} ms the frames take {in_words(make_codec(), period_s)}."]


def _law_cells(law: LawSummary) -> tuple[str, ...]:
    return (
        f"`{law.law}`",
        f"{law.reference_error_pct:.3f}",
        f"{law.worst_plant_error_pct:.3f} ({law.worst_plant})",
        f"{law.worst_dwell_pct:.2f}",
        str(law.limit_cycles),
        str(law.unsettled),
        _ms(law.median_settle_1pct_s),
        _ratio(law.settle_ratio),
        f"{law.travel_ratio:.2f}",
        _ratio(law.error_ratio),
    )


def _interval(row: Standing) -> str:
    if row.mean_error_low_pct is None or row.mean_error_high_pct is None:
        return f"{row.mean_error_pct:.3f}"
    return f"{row.mean_error_pct:.3f} ({row.mean_error_low_pct:.3f}–{row.mean_error_high_pct:.3f})"


def draw_league(path: Path, report: LeagueReport) -> None:
    """Draw the picture: mean error with its interval on every plant, and settling against the limit."""
    figure = Figure(figsize=(14.0, 7.0), dpi=110)
    FigureCanvasAgg(figure)
    errors, settling = figure.subplots(1, 2, width_ratios=(3, 1))
    plants = list(dict.fromkeys(standing.plant for standing in report.standings))
    laws = [summary.law for summary in report.summaries]
    for index, law in enumerate(laws):
        _draw_law(errors, report, law, index, plants, 0.7 * ((index + 0.5) / len(laws) - 0.5))
    errors.set_yscale("log")
    errors.set_xticks(range(len(plants)), plants, rotation=20)
    errors.set_ylabel("mean |error| of the last half second, % of span")
    one = len(report.settings.seeds) == 1
    errors.set_title(
        "steady error" if one else "steady error, with 95 % intervals over the seeds", loc="left", fontweight="bold"
    )
    errors.grid(axis="y", color="#DDDDDD", linewidth=0.6)
    errors.legend(frameon=False, ncols=3, fontsize=9, loc="upper left", bbox_to_anchor=(0.0, -0.14))
    times = [(s.law, s.median_settle_1pct_s) for s in report.summaries if s.median_settle_1pct_s is not None]
    for index, (law, time_s) in enumerate(times):
        settling.barh(index, time_s * 1e3, color=_PALETTE[laws.index(law) % len(_PALETTE)])
        settling.annotate(f"{time_s * 1e3:.1f}", (time_s * 1e3, index), xytext=(4, -3), textcoords="offset points")
    settling.axvline(report.optimal_settle_1pct_s * 1e3, color="#222222", linewidth=1.0, linestyle="--")
    settling.set_xscale("log")
    settling.set_yticks(range(len(times)), [law for law, _ in times])
    settling.invert_yaxis()
    settling.set_xlabel("median settling to 1 %, ms; dashed: time-optimal limit")
    settling.set_title(f"speed, {reference_plant(report.settings.plants)}", loc="left", fontweight="bold")
    for panel in (errors, settling):
        panel.spines[["top", "right"]].set_visible(False)
    settings = report.settings
    figure.suptitle(
        f"League at {1e-3 / settings.period_s:g} kHz: {len(laws)} laws × {len(plants)} plants × seeds "
        f"{', '.join(map(str, settings.seeds))}, dwells of {settings.dwell_s:g} s",
        x=0.01,
        ha="left",
    )
    figure.tight_layout()
    figure.savefig(path)


def _draw_law(panel: Axes, report: LeagueReport, law: str, index: int, plants: list[str], shift: float) -> None:
    rows = {standing.plant: standing for standing in report.standings if standing.law == law}
    where = [number + shift for number, name in enumerate(plants) if name in rows]
    shown = [rows[name] for name in plants if name in rows]
    means = [max(row.mean_error_pct, _LEAST_SHOWN_PCT) for row in shown]
    lows = [row.mean_error_pct if row.mean_error_low_pct is None else row.mean_error_low_pct for row in shown]
    highs = [row.mean_error_pct if row.mean_error_high_pct is None else row.mean_error_high_pct for row in shown]
    below = [max(mean - max(low, _LEAST_SHOWN_PCT), 0.0) for mean, low in zip(means, lows, strict=True)]
    above = [max(high - mean, 0.0) for mean, high in zip(means, highs, strict=True)]
    color, mark = _PALETTE[index % len(_PALETTE)], _MARKS[index % len(_MARKS)]
    panel.errorbar(where, means, yerr=(below, above), fmt=mark, color=color, markersize=6, linewidth=1.2, label=law)
    for place, row in zip(where, shown, strict=True):
        if row.mean_error_pct < _LEAST_SHOWN_PCT:
            text = f"{row.mean_error_pct:.0e} ↓"
            panel.annotate(text, (place, _LEAST_SHOWN_PCT), xytext=(6, -3), textcoords="offset points", fontsize=8)


def _ms(time_s: float | None) -> str:
    return "never" if time_s is None else f"{time_s * 1e3:.1f}"


def _ratio(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f}"
