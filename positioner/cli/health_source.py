"""The health of a valve for a command: as its state directory keeps it, or counted again in a log. Shell."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from typing import TYPE_CHECKING, Any

from positioner.cli.tables import note
from positioner.errors import StateError
from positioner.health.counters_document import COUNTERS, counters_from
from positioner.health.monitor import sections_of
from positioner.health.trends_document import TRENDS, trends_from
from positioner.inputs.plain_file import MOST_MIB
from positioner.runtime.health_reference import measured_health_settings
from positioner.store import access

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from positioner.config.schema import Configuration
    from positioner.health.counters import Counters
    from positioner.health.monitor import HealthSettings
    from positioner.health.watch import Trends
    from positioner.report.trend_sections import Service


@dataclass(frozen=True, slots=True)
class FoundHealth:
    """The sections of the health, where they were found, and since when and until when, empty for a log."""

    settings: HealthSettings
    counters: Counters
    trends: Trends
    sections: Mapping[str, Any]
    source: str
    started: str = ""
    saved: str = ""


def kept_health(configuration: Configuration, directory: Path, report: Callable[[str], object]) -> FoundHealth:
    """Return the health in a state directory; `report` gets a line of what is wrong with its reference.

    Raises:
        StateError: there is none, it is of another valve, or it cannot be used.
    """
    document = access.health(directory)
    if document.valve_id != configuration.valve.id:
        raise StateError(f"{directory}: the health there is of valve {document.valve_id!r}, not of this one")
    settings = measured_health_settings(configuration, report, directory)
    return _found(settings, document.sections, directory, document.started, document.saved)


def health_in_log(
    log: Path,
    configuration: Configuration,
    directory: Path,
    report: Callable[[str], object],
    *,
    table: Path | None = None,
    before: Mapping[str, Any] | None = None,
    most_mib: int = MOST_MIB,
) -> FoundHealth:
    """Return the health counted in a log, against the reference in `directory`; what makes it inexact goes to stderr.

    table: the state directory with whose stiction table it begins. before: the sections with which it begins.

    Raises:
        LogError, StateError: the log or the table cannot be read.
    """
    from positioner.replay.health_log import health_in  # noqa: PLC0415 - a log library, for a log only

    settings = measured_health_settings(configuration, report, directory)
    health, notices = health_in(log, configuration, settings, table, before or {}, most_mib)
    for notice in notices:
        note(f"{log}: {notice}")
    return _found(settings, sections_of(health), log)


def _found(
    settings: HealthSettings, sections: Mapping[str, Any], source: Path, started: str = "", saved: str = ""
) -> FoundHealth:
    try:
        counters = counters_from(sections.get(COUNTERS))
        trends = trends_from(sections.get(TRENDS), settings.watch.reference)
    except (ValueError, KeyError, TypeError) as error:
        raise StateError(f"{source}: the health there cannot be used: {error}") from error
    return FoundHealth(settings, counters, trends, sections, str(source), started, saved)


def service_of(found: FoundHealth) -> Service:
    """Return what was found as a report shows it.

    Raises:
        StateError: a date in it is none.
    """
    from positioner.report import words  # noqa: PLC0415 - Jinja2 for a report only
    from positioner.report.trend_sections import Service  # noqa: PLC0415

    try:
        until = datetime.fromisoformat(found.saved) if found.saved else None
        started = words.date(datetime.fromisoformat(found.started)) if found.started else ""
    except ValueError as error:
        raise StateError(f"{found.source}: the health there cannot be used: {error}") from error
    return Service(found.counters, found.trends, found.settings.watch, started, until)
