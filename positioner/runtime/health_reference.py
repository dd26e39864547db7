"""What the kept results of test procedures give to the health of a valve: its reference above all. Shell."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from positioner.commissioning import results
from positioner.errors import StateError
from positioner.health.kept_tests import response_watched, stroke_test_watched
from positioner.health.reference import reference_of

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from positioner.commissioning.results import KeptResult
    from positioner.config.schema import Configuration
    from positioner.health.monitor import HealthSettings


def measured_health_settings(
    configuration: Configuration, report: Callable[[str], object], directory: Path | None = None
) -> HealthSettings:
    """Return what health is computed with, against the valve as it was measured; `report` gets a line of what is wrong.

    directory: the state directory; that of the configuration without one. Without a kept result the configured valve
    stands in, and no trend is an alarm.
    """
    settings, folder = configuration.health_settings, directory or configuration.state_directory
    try:
        signature, identified = (results.reference(folder, kind, report) for kind in ("signature", "identify"))
        given = [None if each is None else (_date(each), each.document) for each in (identified, signature)]
        watch = replace(settings.watch, reference=reference_of(configuration.valve, *given))
        steps = results.kept(folder, "step-test", report)
        if steps and (reference := results.reference_of(folder, steps)) is not None:
            watch = replace(watch, response=response_watched(_date(steps[-1]), steps[-1].document, reference.document))
        strokes = results.kept(folder, "stroke-test", report)
        if strokes:
            watch = replace(watch, stroke_test=stroke_test_watched(_date(strokes[-1]), strokes[-1].document))
        every_s = configuration.health.stroke_test_s
        if every_s > 0.0:
            last = [each.recorded for each in strokes if each.document["verdict"] != "aborted"]
            age_s = (datetime.now(UTC) - last[-1]).total_seconds() if last else every_s
            watch = replace(watch, stroke_test_due_s=max(every_s - age_s, 0.0))
    except (StateError, KeyError, TypeError, ValueError, StopIteration) as error:
        report(f"{folder}: a kept result is not as expected ({error}): friction and spring have no reference")
        return settings
    return replace(settings, watch=watch)


def _date(kept: KeptResult) -> str:
    return kept.recorded.strftime("%Y-%m-%d")
