"""The reference of a valve's health: the kept results of `signature` and `identify` in its state directory. Shell."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from positioner.commissioning import results
from positioner.errors import StateError
from positioner.health.reference import reference_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from positioner.config.schema import Configuration
    from positioner.health.monitor import HealthSettings


def measured_health_settings(configuration: Configuration, report: Callable[[str], object]) -> HealthSettings:
    """Return what health is computed with, against the valve as it was measured; `report` gets a line of what is wrong.

    Without a kept result the configured valve stands in, and no trend is an alarm.
    """
    settings, directory = configuration.health_settings, configuration.state_directory
    try:
        signature, identified = (results.reference(directory, kind, report) for kind in ("signature", "identify"))
        given = [
            None if each is None else (each.recorded.isoformat(), each.document) for each in (identified, signature)
        ]
        reference = reference_of(configuration.valve, *given)
    except (StateError, KeyError, TypeError, ValueError, StopIteration) as error:
        report(f"no reference for friction and spring: the kept result is not as expected ({error})")
        return settings
    return replace(settings, watch=replace(settings.watch, reference=reference))
