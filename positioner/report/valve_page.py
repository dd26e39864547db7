"""The report of a valve: its verdict, what was measured, how it has been used, and how it is set. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from positioner.report import words
from positioner.report.health_page import use_sections
from positioner.report.page import Page, Section
from positioner.report.procedure_page import section_of
from positioner.report.procedure_section import missing_section
from positioner.report.trend_sections import alarm_section
from positioner.report.valve_verdict import verdict_of_valve

if TYPE_CHECKING:
    from collections.abc import Mapping
    from datetime import datetime

    from positioner.commissioning.results import KeptResult
    from positioner.report.trend_sections import Service

_PURPOSES = {
    "signature": ("Signature", "measures spring, friction along the travel, hysteresis and bench set"),
    "step-test": ("Step response", "measures dead time, response times, overshoot and dead band"),
    "stroke-test": ("Partial stroke test", "moves the valve partly and back, and judges it"),
    "identify": ("Identification", "measures spring, friction, lag and noise"),
}


@dataclass(frozen=True, slots=True)
class ValveReport:
    """All that the report shows.

    results: by kind, the newest result and the reference, which may be the same. signatures: all, oldest first.
    service: None where nothing was counted. running: the test procedure that moves the valve now, empty without one.
    warnings: what the configuration will not do well. options: of the commands that it names.
    """

    valve: str
    span_m: float
    made: datetime
    results: Mapping[str, tuple[KeptResult, KeptResult]]
    signatures: tuple[KeptResult, ...]
    service: Service | None
    facts: tuple[tuple[str, str], ...]
    options: str
    running: str = ""
    warnings: tuple[str, ...] = ()


def valve_page(report: ValveReport) -> Page:
    """Return the page."""
    service = report.service
    sections = [alarm_section(service.trends.alarms)] if service and service.trends.alarms else []
    sections += [_measured(report, "signature"), _measured(report, "step-test")]
    if service is None:
        what = "Nothing was counted yet: the counters begin when the valve is in service, with positioner run"
        sections.append(Section("Friction trend, histograms and counters", missing=f"{what} {report.options}."))
    else:
        sections += use_sections(service, report.signatures, report.span_m)
    sections.append(_measured(report, "stroke-test"))
    if "signature" not in report.results:
        sections.append(_measured(report, "identify"))
    if report.warnings:
        sections.append(Section("Warnings of the configuration", remarks=report.warnings))
    verdict = verdict_of_valve(report.results, service, report.running, report.options)
    return Page(report.valve, f"Valve report, {words.date(report.made)}", tuple(sections), verdict, report.facts)


def _measured(report: ValveReport, kind: str) -> Section:
    if kind in report.results:
        return section_of(*report.results[kind])
    title, purpose = _PURPOSES[kind]
    return missing_section(title, f"positioner {kind} {report.options}", purpose)
