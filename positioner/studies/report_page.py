"""The report of a league: verdict, tables, picture, settings, and the command that plays it again. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.report.page import Page, Section, Status, Verdict
from positioner.report.table import Table
from positioner.report.text import unmarked

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from positioner.report.picture import Picture
    from positioner.report.text import Block
    from positioner.studies.real_valves.goals import Judgement
    from positioner.studies.standings import LawSummary


def study_page(
    title: str,
    verdict: Verdict,
    found: Iterable[Block],
    picture: Picture,
    settings: Mapping[str, object],
    command: str,
    versions: Mapping[str, str],
) -> Page:
    """Return the page of a league; `found` are its tables and lines, as a terminal shows them."""
    tables, lines = [], []
    for block in found:
        if isinstance(block, Table):
            tables.append(_unmarked(block))
        elif block.strip():
            lines.append(unmarked(block))
    facts = tuple((name.replace("_", " "), _text(value)) for name, value in settings.items())
    sections = (
        Section("Picture", pictures=(picture,)),
        Section("Figures", tables=tuple(tables), remarks=tuple(lines)),
        Section("Settings", facts=facts, remarks=(f"To play it again: {command}",)),
    )
    return Page(title, "League of laws", sections, verdict, tuple(versions.items()), is_wide=True)


def league_verdict(laws: Sequence[LawSummary]) -> Verdict:
    """Return which law is the best, and by how much."""
    best = laws[0]
    sentence = f"{best.worst_plant_error_pct:.3f} % mean error on its worst plant, {best.worst_plant}"
    if len(laws) > 1:
        following = laws[1]
        sentence += f"; the next one, {following.law}, has {following.worst_plant_error_pct:.3f} % on its worst"
    sentence += f". {best.limit_cycles} limit cycles, {best.unsettled} dwells that never settle."
    status = Status.OUT_OF_SPECIFICATION if best.limit_cycles or best.unsettled else Status.GOOD
    return Verdict(status, sentence, "", f"{best.law} is the most accurate of {len(laws)} laws")


def goals_verdict(goals: Sequence[Judgement]) -> Verdict:
    """Return how many goals are met."""
    judged = [each for each in goals if each.is_met is not None]
    missed = [each.goal for each in judged if not each.is_met]
    if not judged:
        return Verdict(Status.UNKNOWN, "This part of the league decides no goal.", "", "No goal is judged")
    heading = f"{len(judged) - len(missed)} of {len(judged)} goals are met"
    if missed:
        return Verdict(Status.OUT_OF_SPECIFICATION, f"Missed: {'; '.join(missed)}.", "", heading)
    return Verdict(Status.GOOD, "No goal is missed.", "", heading)


def _unmarked(table: Table) -> Table:
    rows = [[unmarked(cell) for cell in row] for row in table.rows]
    return Table(tuple(map(unmarked, table.head)), Table.of((), rows).rows, unmarked(table.caption), table.marked)


def _text(value: object) -> str:
    if isinstance(value, (tuple, list)):
        return ", ".join(map(_text, value))
    return "–" if value is None else str(value)
