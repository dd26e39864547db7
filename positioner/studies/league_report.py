"""The files of a league: `league.json`, `league.md`, `league.png` and `.svg`. Shell, because it writes files."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import TYPE_CHECKING

from positioner.doctor.bus_load import REFUSE_ABOVE, bus_load, in_words
from positioner.pictures.files import save
from positioner.report.table import Table
from positioner.report.text import markdown
from positioner.studies.conditions import reference_plant
from positioner.studies.league_picture import league_figure
from positioner.wire.codec import make_codec

if TYPE_CHECKING:
    from pathlib import Path

    from positioner.report.text import Block
    from positioner.studies.league_picture import LeagueReport
    from positioner.studies.standings import LawSummary, Standing

_INTERVALS = (
    "In parentheses: 95 % percentile bootstrap over the means of {} seeds, because the dwells of one run correlate; "
    "with few seeds the interval is hardly more than their range."
)


def write_report(folder: Path, report: LeagueReport) -> None:
    """Write the files into `folder`."""
    (folder / "league.json").write_text(json.dumps(asdict(report), indent=2) + "\n", encoding="utf-8")
    (folder / "league.md").write_text(to_markdown(report), encoding="utf-8")
    save(league_figure(report), folder / "league.png")


def to_markdown(report: LeagueReport) -> str:
    """Return the standings in Markdown."""
    return markdown(blocks(report))


def blocks(report: LeagueReport) -> list[Block]:
    """Return the standings as two tables: the laws over all plants, and each law on each plant."""
    figures = (
        f"{reference_plant(report.settings.plants)}, %",
        "worst plant, %",
        "worst dwell, %",
        "limit cycles",
        "unsettled",
        "settles to 1 %, ms",
    )
    head = ("law", *figures, "× limit", "travel / ideal", "× nmpc")
    rows = [_law_cells(law) for law in report.summaries]
    if report.optimal_settle_1pct_s is not None:
        limit = f"{_ms(report.optimal_settle_1pct_s)} (rests after {_ms(report.optimal_rest_s)})"
        rows.append(("time-optimal limit", "–", "–", "–", "–", "–", limit, "1.00", "1.00", "–"))
    found: list[Block] = [Table.of(head, rows), ""]
    plants = list(dict.fromkeys(standing.plant for standing in report.standings))
    seeds = len(report.settings.seeds)
    heading = "mean error, %" if seeds == 1 else "mean error, % (95 %)"
    cells = {(row.law, row.plant): _interval(row) for row in report.standings}
    rows = [(f"`{law.law}`", *(cells.get((law.law, plant), "–") for plant in plants)) for law in report.summaries]
    found += [Table.of((heading, *plants), rows), ""]
    found += ["A single seed: no interval." if seeds == 1 else _INTERVALS.format(seeds)]
    return found + _caveat(report.settings.period_s)


def _caveat(period_s: float) -> list[Block]:
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


def _ms(time_s: float | None) -> str:
    return "never" if time_s is None else f"{time_s * 1e3:.1f}"


def _ratio(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f}"
