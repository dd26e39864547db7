"""The page of `positioner health --report`: how a valve is, and how it has been used. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.report import words
from positioner.report.counter_sections import counter_section, histogram_section
from positioner.report.page import Page
from positioner.report.trend_sections import alarm_section, trend_section
from positioner.report.valve_verdict import verdict_of_valve

if TYPE_CHECKING:
    from collections.abc import Sequence
    from datetime import datetime

    from positioner.commissioning.results import KeptResult
    from positioner.report.page import Section
    from positioner.report.trend_sections import Service


def health_page(
    valve: str,
    span_m: float,
    made: datetime,
    service: Service,
    signatures: Sequence[KeptResult],
    facts: tuple[tuple[str, str], ...],
    options: str,
) -> Page:
    """Return the page; `signatures` are the kept ones, oldest first, `options` those of the commands that it names."""
    sections = (alarm_section(service.trends.alarms), *use_sections(service, signatures, span_m))
    verdict = verdict_of_valve({}, service, "", options)
    return Page(valve, f"Health, {words.date(made)}", sections, verdict, facts)


def use_sections(service: Service, signatures: Sequence[KeptResult], span_m: float) -> tuple[Section, ...]:
    """Return trend, histograms and counters."""
    since = f"since {service.started}" if service.started else "counted from the log"
    return (
        trend_section(service, signatures),
        histogram_section(service.counters, since),
        counter_section(service.counters, span_m, since, service.watch.wear),
    )
