"""The work of `table dump`, `table reset` and `table import`: in a running table writer, or on the files alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from positioner.errors import StateError
from positioner.store import database, health_file, messages
from positioner.store.content import StoredTable
from positioner.store.file_check import Fault, TableRejectedError
from positioner.store.health_document import to_plain
from positioner.store.health_file import HealthFile
from positioner.store.health_keeper import HealthKeeper
from positioner.store.health_messages import HealthDumped, HealthRequest, HealthResetRequest
from positioner.store.table_directory import GOOD_COPY, TABLE, WRITING_FAILED, TableDirectory, remedy
from positioner.valve.stiction import StictionTable

if TYPE_CHECKING:
    from pathlib import Path


@dataclass(frozen=True, slots=True)
class Replacement:
    """The table that was put in place, why, and the backup of the former one, if that held anything."""

    stored: StoredTable
    reason: str
    backup: str | None


def replaced(tables: TableDirectory, stored: StoredTable, request: messages.Message) -> Replacement:
    """Return the replacement of `stored` by a reset or an import, once it is on the disk.

    Before that `stored` is backed up, unless it is empty.

    Raises:
        StateError: it was refused or could not be saved; nothing was changed.
    """
    match request:
        case messages.ResetRequest():
            occasion, successor = "reset", stored.emptied()
        case messages.ImportRequest(offered, force):
            _check(stored, offered, force=force)
            occasion, successor = "import", stored.succeeded_by(offered)
        case _:
            raise StateError(f"not a request: {request}")
    try:
        backup = tables.back_up(stored, occasion) if len(stored.table) else None
        tables.save(successor)
    except WRITING_FAILED as error:
        raise StateError(f"nothing was changed, since the table cannot be saved: {remedy(error)}") from error
    suffix = f"; the former one is in {backup}" if backup else ""
    return Replacement(successor, f"{occasion}{suffix}", str(backup) if backup else None)


def on_files(directory: Path, request: messages.Message) -> messages.Answer:
    """Return the answer to `request` from the files, while no daemon runs; only a dump may run beside a table writer.

    Raises:
        StateError: nothing was changed; the message says why.
    """
    if isinstance(request, messages.DumpRequest):
        return messages.Dumped(_readable(directory))
    if isinstance(request, HealthRequest):
        return HealthDumped(to_plain(health_file.read(directory)))
    if isinstance(request, HealthResetRequest):
        document = health_file.read(directory)
        file = HealthFile(directory, document.valve_id)
        return messages.Done(HealthKeeper(file, file.load()).reset(request.sections, request.given))
    owner = _owner(directory, request)
    tables = TableDirectory(directory, owner.valve_id, owner.table.cell_width_m)
    try:
        done = replaced(tables, tables.load(), request)
        tables.copy(done.stored)
    except WRITING_FAILED as error:
        raise error if isinstance(error, StateError) else StateError(f"{directory}: {remedy(error)}") from error
    finally:
        tables.close()
    return messages.Done(done.backup)


def _check(stored: StoredTable, offered: StoredTable, *, force: bool) -> None:
    if offered.valve_id != stored.valve_id and not force:
        raise StateError(
            f"the table to import is of valve {offered.valve_id!r}, this is {stored.valve_id!r}; --force takes it"
        )
    if offered.table.cell_width_m != stored.table.cell_width_m:
        raise StateError(
            f"the table to import has cells of {offered.table.cell_width_m:g} m,"
            f" this valve's are {stored.table.cell_width_m:g} m wide: it cannot be converted"
        )


def _readable(directory: Path) -> StoredTable:
    """Return the table, or its good copy where the table is missing or damaged."""
    try:
        return database.read(directory / TABLE)
    except TableRejectedError as rejected:
        try:
            return database.read(directory / GOOD_COPY)
        except TableRejectedError:
            raise rejected from None


def _owner(directory: Path, request: messages.Message) -> StoredTable:
    """Return the table that names the directory's valve: the one in it, or else an empty one for the import."""
    try:
        return _readable(directory)
    except TableRejectedError as rejected:
        if not isinstance(request, messages.ImportRequest) or rejected.fault in {Fault.FOREIGN, Fault.NEWER_SCHEMA}:
            raise
        empty = StictionTable(cell_width_m=request.stored.table.cell_width_m)
        return StoredTable(request.stored.valve_id, empty)
