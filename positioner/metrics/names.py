"""The names of the values of labels: of modes, causes, signals, events and alarms. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.health.causes import AlarmCause
from positioner.wire.messages import Cause, Counted, Health, Mode

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from enum import IntEnum


def _named(values: Iterable[IntEnum]) -> Mapping[int, str]:
    return {int(value): value.name.lower() for value in values}


ALARMS = _named(AlarmCause)
"""By their bits."""
MODES, CAUSES, HEALTH, EVENTS = _named(Mode), _named(Cause), _named(Health), _named(Counted)
