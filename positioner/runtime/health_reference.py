"""What the kept results of test procedures give to the health of a valve: its reference above all. Shell."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from positioner.commissioning import results
from positioner.errors import StateError
from positioner.health.kept_tests import response_watched, stroke_test_watched
from positioner.health.reference import other_travel, reference_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from positioner.commissioning.results import KeptResult
    from positioner.config.schema import Configuration
    from positioner.health.monitor import HealthSettings


def measured_health_settings(
    configuration: Configuration,
    report: Callable[[str], object],
    directory: Path | None = None,
    *,
    aside: bool = False,
) -> HealthSettings:
    """Return what health is computed with, against the valve as it was measured; `report` gets a line of what is wrong.

    directory: the state directory; that of the configuration without one. Without a kept result the configured valve
    stands in, and no trend is an alarm. With `aside`, for who holds the directory, what is no result is moved aside.
    """
    settings, folder = configuration.health_settings, directory or configuration.state_directory
    valve_id = configuration.valve.id
    try:
        signature, identified = (
            _measured(configuration, folder, kind, report, aside=aside) for kind in ("signature", "identify")
        )
        watch = replace(settings.watch, reference=reference_of(configuration.valve, identified, signature))
        steps = results.kept_of(folder, "step-test", valve_id, report, aside=aside)
        if steps and (reference := results.reference_of(folder, steps, report, aside=aside)) is not None:
            watch = replace(watch, response=response_watched(_date(steps[-1]), steps[-1].document, reference.document))
        strokes = results.kept_of(folder, "stroke-test", valve_id, report, aside=aside)
        if strokes:
            watch = replace(watch, stroke_test=stroke_test_watched(_date(strokes[-1]), strokes[-1].document))
        every_s = configuration.health.stroke_test_s
        if every_s > 0.0:
            last = [each.recorded for each in strokes if each.document["verdict"] != "aborted"]
            age_s = (datetime.now(UTC) - last[-1]).total_seconds() if last else every_s
            # after a step of the clock a test may be of the future: it is then as one of this moment
            watch = replace(watch, stroke_test_due_s=min(max(every_s - age_s, 0.0), every_s))
    except (StateError, KeyError, TypeError, ValueError) as error:
        report(f"{folder}: a kept result is not as expected ({error}): friction and spring have no reference")
        return settings
    return replace(settings, watch=watch)


def _measured(
    configuration: Configuration, folder: Path, kind: str, report: Callable[[str], object], *, aside: bool
) -> tuple[str, Mapping[str, Any]] | None:
    """Return date and document of the reference of this valve, None without one; one of another travel is told."""
    found = results.reference(folder, kind, configuration.valve.id, report, aside=aside)
    if found is None:
        return None
    if other := other_travel(configuration.valve, found.document):
        report(f"{folder}: the {kind} of {_date(found)} is no reference: {other}: measure it again with --as-reference")
        return None
    return _date(found), found.document


def _date(kept: KeptResult) -> str:
    """Return the instant of a result: two of one day are two references."""
    return kept.recorded.strftime("%Y-%m-%dT%H:%M:%SZ")
