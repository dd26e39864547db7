"""What a command does to the files themselves, while no daemon has them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.errors import StateError
from positioner.store import database, messages, requests
from positioner.store.content import StoredTable
from positioner.store.file_check import Fault, TableRejectedError
from positioner.store.table_directory import GOOD_COPY, TABLE, WRITING_FAILED, TableDirectory, remedy
from positioner.valve.stiction import StictionTable

if TYPE_CHECKING:
    from pathlib import Path


def at_the_files(directory: Path, request: messages.Request) -> messages.Answer:
    """Return the answer that the files give, which nobody else writes meanwhile but for a table writer while one dumps.

    Raises:
        StateError: nothing was changed; the message says why.
    """
    if isinstance(request, messages.DumpRequest):
        return messages.Dumped(_readable(directory))
    owner = _owner(directory, request)
    table_directory = TableDirectory(directory, owner.valve_id, owner.table.cell_width_m)
    try:
        done = requests.replaced(table_directory, table_directory.load(), request)
        table_directory.copy(done.stored)
    except WRITING_FAILED as error:
        raise error if isinstance(error, StateError) else StateError(f"{directory}: {remedy(error)}") from error
    finally:
        table_directory.close()
    return messages.Done(done.backup)


def _readable(directory: Path) -> StoredTable:
    """Return the table, or its good copy where the table is missing or damaged."""
    try:
        return database.read(directory / TABLE)
    except TableRejectedError as rejected:
        try:
            return database.read(directory / GOOD_COPY)
        except TableRejectedError:
            raise rejected from None


def _owner(directory: Path, request: messages.Request) -> StoredTable:
    """Return the table that says whose directory this is: the one in it, or else the one to import."""
    try:
        return _readable(directory)
    except TableRejectedError as rejected:
        if not isinstance(request, messages.ImportRequest):
            raise
        if rejected.fault in {Fault.FOREIGN, Fault.NEWER_SCHEMA}:
            raise
        empty = StictionTable(cell_width_m=request.stored.table.cell_width_m)
        return StoredTable(request.stored.valve_id, empty)
