"""The page of one test procedure, for its `--report`, and the section that the report of the valve takes from it. Pure.

A document holds `rows` (`commissioning/report.Row`) and `remarks`. A kind with figures, a table or a verdict of its own
has them in `_PARTS`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from positioner.report import words
from positioner.report.identify_parts import identify_charts, identify_verdict
from positioner.report.page import Page, Section
from positioner.report.procedure_section import procedure_section
from positioner.report.signature_charts import signature_charts, signature_verdict
from positioner.report.step_parts import step_charts, step_table, step_verdict
from positioner.report.stroke_parts import stroke_charts, stroke_facts, stroke_verdict

if TYPE_CHECKING:
    from collections.abc import Callable

    from positioner.commissioning.results import KeptResult
    from positioner.report.chart import Chart
    from positioner.report.page import Verdict
    from positioner.report.table import Table

    Document = dict[str, Any]

_UNREADABLE = (ArithmeticError, AttributeError, LookupError, TypeError, ValueError)
"""What a document of another version, or a damaged one, leads to."""


@dataclass(frozen=True, slots=True)
class Parts:
    """What a kind of result shows besides its rows and remarks."""

    title: str
    charts: Callable[[Document, Document | None], tuple[Chart, ...]] | None = None
    table: Callable[[Document], Table] | None = None
    facts: Callable[[Document, Document | None], tuple[tuple[str, str], ...]] | None = None
    verdict: Callable[[Document], Verdict | None] | None = None


_PARTS = {
    "identify": Parts("Identification", identify_charts, verdict=identify_verdict),
    "signature": Parts("Signature", signature_charts, verdict=signature_verdict),
    "step-test": Parts("Step response", step_charts, step_table, verdict=step_verdict),
    "stroke-test": Parts("Partial stroke test", stroke_charts, facts=stroke_facts, verdict=stroke_verdict),
}
KINDS = tuple(_PARTS)
"""The kinds of results that a report shows."""


def parts_of(kind: str) -> Parts:
    """Return what a kind of result shows."""
    return _PARTS.get(kind, Parts(kind.replace("-", " ").capitalize()))


def charts_of(kind: str, document: Document, reference: Document | None) -> tuple[Chart, ...]:
    """Return the figures of a result, over those of an earlier one, None where there is none to compare with."""
    draw = parts_of(kind).charts
    return draw(document, reference) if draw else ()


def section_of(result: KeptResult, reference: KeptResult | None) -> Section:
    """Return the section of a result, over the reference of its kind; a damaged one says so."""
    parts = parts_of(result.kind)
    before = reference.document if reference is not None and reference.name != result.name else None
    try:
        charts = charts_of(result.kind, result.document, before)
        tables = (parts.table(result.document),) if parts.table else ()
        facts = parts.facts(result.document, before) if parts.facts else ()
        return procedure_section(parts.title, result, reference, charts, tables, facts)
    except _UNREADABLE:
        what = f"The result of {words.date(result.recorded)} or its reference lacks something"
        return Section(parts.title, missing=f"{what}: run positioner {result.kind} --as-reference again.")


def verdict_of(result: KeptResult) -> Verdict | None:
    """Return the verdict of a procedure that judges the valve, None for others."""
    judge = parts_of(result.kind).verdict
    try:
        return judge(result.document) if judge else None
    except _UNREADABLE:
        return None


def procedure_page(result: KeptResult, reference: KeptResult | None, facts: tuple[tuple[str, str], ...]) -> Page:
    """Return the page of one result; `facts` are the settings that it depends on."""
    subtitle = f"{parts_of(result.kind).title}, {words.date(result.recorded)}"
    told = (*facts, *(result.versions.items()))
    return Page(result.valve, subtitle, (section_of(result, reference),), verdict_of(result), told)
