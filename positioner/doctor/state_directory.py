"""Findings on the state directory: is it there, is it writable, is there free space, is its table readable? Shell."""

from __future__ import annotations

import os
import shlex
import shutil
from typing import TYPE_CHECKING

from positioner.doctor.finding import Finding, Level
from positioner.errors import StateError
from positioner.store import access, lock
from positioner.store.file_check import Fault, TableRejectedError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from positioner.config.locations import Location
    from positioner.config.schema import Configuration
    from positioner.store.content import StoredTable

ROOM_WANTED_BYTES = 100 << 20
ROOM_NEEDED_BYTES = 1 << 20
_SUBJECT = "state"


def findings(configuration: Configuration, place: Location) -> Iterator[Finding]:
    """Yield the findings on the directory and on the table in it."""
    try:
        yield from _findings(configuration, place)
    except PermissionError:
        text = f"{place.state} is not accessible for this user"
        yield Finding(
            Level.WARN, _SUBJECT, text, f"sudo ls -l {shlex.quote(str(place.state))}  # or run the doctor with sudo"
        )


def _findings(configuration: Configuration, place: Location) -> Iterator[Finding]:
    if not place.state.is_dir():
        yield _absent(place)
        return
    yield from _room(place, lock.holder(place.state))
    yield _table(configuration, place)


def _absent(place: Location) -> Finding:
    directory = place.state
    nearest = next(above for above in directory.parents if above.exists())
    if place.unit or (nearest.is_dir() and os.access(nearest, os.W_OK | os.X_OK)):
        start = f"the first start of {place.unit}" if place.unit else "the first start"
        return Finding(Level.OK, _SUBJECT, f"{directory} does not exist yet: {start} makes it")
    text = f"{directory} does not exist, and this user cannot make it in {nearest}"
    return Finding(Level.FAIL, _SUBJECT, text, _make(directory))


def _room(place: Location, held_by: int | None) -> Iterator[Finding]:
    directory = place.state
    if place.unit is None and held_by is None and not os.access(directory, os.W_OK | os.X_OK):
        yield Finding(Level.FAIL, _SUBJECT, f"{directory} is not writable for this user", _make(directory))
        return
    free = shutil.disk_usage(directory).free
    text = f"{directory}: {free / (1 << 20):.0f} MiB free"
    show = f"df -h {shlex.quote(str(directory))}  # then free some space"
    if free < ROOM_NEEDED_BYTES:
        yield Finding(Level.FAIL, _SUBJECT, f"{text}: the table cannot be saved", show)
    elif free < ROOM_WANTED_BYTES:
        yield Finding(Level.WARN, _SUBJECT, text, show)
    else:
        yield Finding(Level.OK, _SUBJECT, text)


def _table(configuration: Configuration, place: Location) -> Finding:
    directory = place.state
    dump = f"positioner table dump --state {shlex.quote(str(directory))}"
    if not os.access(directory, os.R_OK | os.X_OK):
        return Finding(Level.WARN, "table", f"{directory} cannot be read by this user", f"sudo {dump}")
    try:
        stored = access.dump(directory)
    except TableRejectedError as rejected:
        if rejected.fault is Fault.MISSING:
            return Finding(Level.OK, "table", "none yet: nothing has been learned")
        return Finding(Level.FAIL, "table", str(rejected), f"{dump}  # the next start sets the file aside")
    except StateError as error:
        return Finding(Level.FAIL, "table", str(error), dump)
    return _assessed(configuration, stored, dump)


def _assessed(configuration: Configuration, stored: StoredTable, dump: str) -> Finding:
    samples = sum(cell.count for _, cell in stored.table)
    text = f"valve {stored.valve_id}: {samples} samples in {len(stored.table)} cells"
    expected, width_m = configuration.valve.id, configuration.control.table_cell_m
    if stored.valve_id != expected:
        text += f", but this valve is {expected}: the next start sets the table aside"
        return Finding(Level.WARN, "table", text, dump)
    if stored.table.cell_width_m != width_m:
        found_mm, wanted_mm = stored.table.cell_width_m * 1e3, width_m * 1e3
        text += f" of {found_mm:g} mm, but the configuration says {wanted_mm:g} mm: the next start sets the table aside"
        return Finding(Level.WARN, "table", text, dump)
    return Finding(Level.OK, "table", text)


def _make(directory: os.PathLike[str]) -> str:
    return f"sudo install -d -m 750 -o $(id -un) {shlex.quote(str(directory))}"
