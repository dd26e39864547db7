"""Where a valve's state is kept, and the systemd unit that runs it: both follow from the path of its file. Shell."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from positioner.config.schema import Configuration

CONFIGURATIONS = Path("/etc/positioner")
SERVICE_STATES = Path("/var/lib/positioner")


@dataclass(frozen=True, slots=True)
class Location:
    """The state directory of a valve, and its unit; None for a positioner that no installed unit runs."""

    state: Path
    unit: str | None


def location_of(configuration: Configuration, path: Path, state: Path | None = None) -> Location:
    """Return the location of a valve of the configuration in `path`; `state` is a directory given by the user.

    The unit `positioner@NAME` reads `/etc/positioner/NAME.toml` and keeps its state in `/var/lib/positioner/NAME`,
    unless the file gives another directory. Of several valves each has a folder of its own there.
    """
    absolute = path.absolute()
    is_of_unit = absolute.parent == CONFIGURATIONS and absolute.suffix == ".toml"
    unit = f"positioner@{absolute.stem}" if is_of_unit else None
    if state is None:
        served = is_of_unit and configuration.state.directory is None
        parent = SERVICE_STATES / absolute.stem
        own = parent / configuration.subfolder if served else configuration.state_directory
    else:
        own = state / configuration.subfolder
    return Location(own.absolute(), unit)
