"""The page of one test procedure, for its `--report`, and the section that the report of the valve takes from it. Pure.

A document holds `rows` (`commissioning/report.Row`), `remarks`, and, where the procedure judges the valve, `verdict`:
an object with `status` (a name of NE 107, like MAINTENANCE_REQUIRED), `sentence` and `action`. A kind with figures of
its own has a function in `_CHARTS`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from positioner.report import words
from positioner.report.page import Page, Section, Status, Verdict
from positioner.report.procedure_section import procedure_section
from positioner.report.signature_charts import signature_charts

if TYPE_CHECKING:
    from collections.abc import Callable

    from positioner.commissioning.results import KeptResult
    from positioner.report.chart import Chart

_TITLES = {
    "identify": "Identification",
    "signature": "Signature",
    "step-test": "Step response",
    "stroke-test": "Partial stroke test",
}
_CHARTS: dict[str, Callable[[dict[str, Any], dict[str, Any] | None], tuple[Chart, ...]]] = {
    "signature": signature_charts,
}


def title_of(kind: str) -> str:
    """Return what a kind of result is called."""
    return _TITLES.get(kind, kind.replace("-", " ").capitalize())


def section_of(result: KeptResult, reference: KeptResult | None) -> Section:
    """Return the section of a result, over the reference of its kind; a damaged one says so."""
    draw = _CHARTS.get(result.kind)
    before = reference.document if reference is not None and reference.name != result.name else None
    try:
        charts = draw(result.document, before) if draw else ()
        return procedure_section(title_of(result.kind), result, reference, charts)
    except (KeyError, TypeError, ValueError, AttributeError, IndexError):
        what = f"The result of {words.date(result.recorded)} or its reference lacks something"
        return Section(title_of(result.kind), missing=f"{what}: run positioner {result.kind} --as-reference again.")


def verdict_of(result: KeptResult) -> Verdict | None:
    """Return the verdict of a procedure that judges the valve, None for others."""
    told = result.document.get("verdict")
    if not isinstance(told, dict) or told.get("status") not in Status.__members__:
        return None
    return Verdict(Status[str(told["status"])], str(told.get("sentence", "")), str(told.get("action", "")))


def procedure_page(result: KeptResult, reference: KeptResult | None, facts: tuple[tuple[str, str], ...]) -> Page:
    """Return the page of one result; `facts` are the settings that it depends on."""
    subtitle = f"{title_of(result.kind)}, {words.date(result.recorded)}"
    told = (*facts, *(result.versions.items()))
    return Page(result.valve, subtitle, (section_of(result, reference),), verdict_of(result), told)
