"""The files of a league on real valves: `real-valves.json`, `.md`, `.png` and `.svg`. Shell."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING

from positioner.pictures.files import save
from positioner.report.table import Table
from positioner.report.text import markdown
from positioner.studies.real_valves.conditions import AS_CONFIGURED, CONDITIONS
from positioner.studies.real_valves.goals import LOW, judged
from positioner.studies.real_valves.picture import real_valves_figure
from positioner.studies.real_valves.valves import GRAPHITE, NOISE_NAMES, NOMINAL

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from positioner.report.text import Block
    from positioner.studies.real_valves.bouts import RealLeagueSettings
    from positioner.studies.real_valves.goals import Judgement
    from positioner.studies.real_valves.results import Cell, Results

_NEVER = "never"


@dataclass(frozen=True, slots=True, kw_only=True)
class RealReport:
    """All that the files show."""

    settings: RealLeagueSettings
    results: Results


def write_report(folder: Path, report: RealReport) -> None:
    """Write the files into `folder`."""
    text = {
        "settings": asdict(report.settings),
        "goals": [{**asdict(each), "is_met": each.is_met} for each in judged(report.results)],
        "optimal_settle_s": {f"{lag_s:g}": value for lag_s, value in report.results.optimal_settle_s.items()},
        "cells": [asdict(cell) for cell in report.results.cells],
    }
    (folder / "real-valves.json").write_text(json.dumps(text, indent=2) + "\n", encoding="utf-8")
    (folder / "real-valves.md").write_text(to_markdown(report), encoding="utf-8")
    save(real_valves_figure(report.results), folder / "real-valves.png")


def to_markdown(report: RealReport) -> str:
    """Return the text in Markdown."""
    return markdown(blocks(report))


def blocks(report: RealReport) -> list[Block]:
    """Return the goals, each law at each lag, and the conditions, as tables."""
    results = report.results
    lines: list[Block] = [_goals(judged(results))]
    for noise in report.settings.noises:
        lines += ["", f"**{NOISE_NAMES[noise]}**: mean on `{NOMINAL}` / worst dwell of all plants / unsettled, %", ""]
        lines.append(_by_lag(results, _errors, noise))
    lines += ["", f"**{NOISE_NAMES[LOW]}**: median settling to 1 % on `{NOMINAL}`, ms", ""]
    optimum = ("time-optimal", *(_ms(results.optimal_settle_s[lag_s]) for lag_s in results.lags_s))
    lines.append(_by_lag(results, _settling, LOW, optimum))
    return lines + _others(results)


def _goals(judgements: Sequence[Judgement]) -> Table:
    rows = [
        (
            each.goal,
            NOISE_NAMES[each.noise],
            f"{'≥' if each.at_least else '≤'} {each.limit:g} {each.unit}".strip(),
            "not played" if each.figure is None else f"{each.figure:.3g} {each.unit}".strip(),
            {None: "–", True: "met", False: "**not met**"}[each.is_met],
        )
        for each in judgements
    ]
    return Table.of(("goal", "noise", "limit", "figure", ""), rows)


def _by_lag(results: Results, text: Callable[[Sequence[Cell]], str], noise: str, *more: Sequence[str]) -> Table:
    """Return a table with a row for each law and a column for each lag, and then the rows `more`."""
    cells = [cell for cell in results.chosen() if cell.noise == noise and cell.plant != GRAPHITE]
    rows = []
    for law in dict.fromkeys(cell.law for cell in cells):
        own = [cell for cell in cells if cell.law == law]
        rows.append((f"`{law}`", *(text([cell for cell in own if cell.lag_s == lag_s]) for lag_s in results.lags_s)))
    return Table.of(("lag, ms", *(f"{lag_s * 1e3:g}" for lag_s in results.lags_s)), [*rows, *more])


def _errors(cells: Sequence[Cell]) -> str:
    nominal = [cell for cell in cells if cell.plant == NOMINAL]
    if not nominal:
        return "–"
    worst, unsettled = max(cell.worst_pct for cell in cells), sum(cell.unsettled for cell in cells)
    return f"{nominal[0].mean_pct:.3f} / {worst:.2f} / {unsettled}"


def _settling(cells: Sequence[Cell]) -> str:
    nominal = [cell for cell in cells if cell.plant == NOMINAL]
    return _ms(nominal[0].median_settle_1pct_s) if nominal else "–"


def _others(results: Results) -> list[Block]:
    """Return the tables of each plant apart, and of the conditions: a line for all lags of one."""
    main = sorted(results.chosen(), key=lambda cell: (cell.plant, cell.noise, cell.law))
    lines: list[Block] = []
    for title, cells in (
        (f"`{GRAPHITE}`", [cell for cell in main if cell.plant == GRAPHITE]),
        ("Conditions", [cell for cell in results.cells if cell.condition != AS_CONFIGURED]),
    ):
        groups: dict[tuple[str, str], list[Cell]] = {}
        for cell in cells:
            name = f"`{cell.law}`" if cell.condition == AS_CONFIGURED else CONDITIONS[cell.condition].text
            groups.setdefault((name, cell.noise), []).append(cell)
        rows = [(name, NOISE_NAMES[noise], *_by_column(some)) for (name, noise), some in groups.items()]
        if rows:
            lines += ["", f"**{title}**", "", Table.of(("", "noise", *_COLUMNS), rows, names=2)]
    return lines


def _by_column(cells: Sequence[Cell]) -> list[str]:
    """Return the text of each column, with the cells' lags side by side."""
    return [" / ".join(text(cell) for cell in cells) for text in _COLUMNS.values()]


_COLUMNS: Mapping[str, Callable[[Cell], str]] = MappingProxyType(
    {
        "lag, ms": lambda cell: f"{cell.lag_s * 1e3:g}",
        "mean, %": lambda cell: f"{cell.mean_pct:.3f}",
        "worst, %": lambda cell: f"{cell.worst_pct:.2f}",
        "settles, ms": lambda cell: _ms(cell.median_settle_1pct_s),
        "unsettled": lambda cell: str(cell.unsettled),
        "cycles": lambda cell: str(cell.limit_cycles),
        "travel / ideal": lambda cell: f"{cell.travel_ratio:.2f}",
    }
)


def _ms(time_s: float | None) -> str:
    return _NEVER if time_s is None else f"{time_s * 1e3:.0f}"
