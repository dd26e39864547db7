"""The messages about the health of a valve between daemon, table writer and command line."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from positioner.inputs.table import SettingsTable


@dataclass(frozen=True, slots=True)
class KeepHealth(SettingsTable):
    """Daemon → table writer: the sections as they are now; of another generation they are dropped."""

    generation: int
    sections: dict[str, Any]


@dataclass(frozen=True, slots=True)
class HealthReplaced(SettingsTable):
    """Table writer → daemon: sections were reset or changed by command; go on from these."""

    generation: int
    sections: dict[str, Any]


NO_HEALTH = HealthReplaced(0, {})


@dataclass(frozen=True, slots=True)
class HealthRequest(SettingsTable):
    """Command line → table writer: send me the health of the valve."""


@dataclass(frozen=True, slots=True)
class HealthResetRequest(SettingsTable):
    """Command line → table writer: back the health up, and begin these sections anew, or with what is given."""

    sections: tuple[str, ...]
    given: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class HealthDumped(SettingsTable):
    """Table writer → command line: the document, as it stands in its file."""

    document: dict[str, Any]
