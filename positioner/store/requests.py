"""What `table reset` and `table import` do, the same whether a table writer runs or not."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from positioner.errors import StateError
from positioner.store import messages
from positioner.store.table_directory import WRITING_FAILED, TableDirectory, remedy

if TYPE_CHECKING:
    from positioner.store.content import StoredTable


@dataclass(frozen=True, slots=True)
class Replacement:
    """The table that was put in place, why, and the backup of the former one, if that held anything."""

    stored: StoredTable
    reason: str
    backup: str | None


def replaced(table_directory: TableDirectory, stored: StoredTable, request: messages.Message) -> Replacement:
    """Return what a reset or an import made of `stored`, once it is backed up and on the disk.

    Raises:
        StateError: it was refused or could not be saved; nothing was changed.
    """
    if isinstance(request, messages.ResetRequest):
        occasion, successor = "reset", stored.emptied()
    elif isinstance(request, messages.ImportRequest):
        _check(stored, request)
        occasion, successor = "import", stored.succeeded_by(request.stored)
    else:
        raise StateError(f"not a request: {request}")
    try:
        backup = table_directory.back_up(stored, occasion) if len(stored.table) else None
        table_directory.save(successor)
    except WRITING_FAILED as error:
        raise StateError(f"nothing was changed, since the table cannot be saved: {remedy(error)}") from error
    suffix = f"; the former one is in {backup}" if backup else ""
    return Replacement(successor, f"{occasion}{suffix}", str(backup) if backup else None)


def _check(stored: StoredTable, request: messages.ImportRequest) -> None:
    offered = request.stored
    if offered.valve_id != stored.valve_id and not request.force:
        raise StateError(
            f"the table to import is of valve {offered.valve_id!r}, this is {stored.valve_id!r}; --force takes it"
        )
    if offered.table.cell_width_m != stored.table.cell_width_m:
        raise StateError(
            f"the table to import has cells of {offered.table.cell_width_m:g} m,"
            f" this valve's are {stored.table.cell_width_m:g} m wide: it cannot be converted"
        )
