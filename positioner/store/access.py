"""The table for the command line: through the table writer while a daemon runs, on the files while none does."""

from __future__ import annotations

import os
import socket
import time
from typing import TYPE_CHECKING, Any, TypeVar

from positioner.errors import AlreadyRunningError, StateError
from positioner.store import as_owner, commands, control, lock, messages
from positioner.store.channel import Channel
from positioner.store.file_check import Fault, TableRejectedError
from positioner.store.health_document import from_plain
from positioner.store.health_messages import HealthDumped, HealthRequest, HealthResetRequest

if TYPE_CHECKING:
    from pathlib import Path

    from positioner.store.content import StoredTable
    from positioner.store.health_document import HealthDocument

T = TypeVar("T")

_LOCK_TIMEOUT_S = 5.0
"""How long to wait for a daemon that is starting or ending, or for another command."""
_RETRY_S = 0.02
_ANSWER_S = 30.0


def dump(directory: Path) -> StoredTable:
    """Return the table in the state directory, which need only be readable.

    Raises:
        StateError: there is no table, or it cannot be read.
    """
    return _ask(directory, messages.DumpRequest(), messages.Dumped).stored


def reset(directory: Path) -> str | None:
    """Empty the table; return the path of the backup, or None where the table was empty already.

    Raises:
        StateError: nothing was changed; the message says why.
    """
    return _ask(directory, messages.ResetRequest(), messages.Done).backup


def replace(directory: Path, stored: StoredTable, *, force: bool) -> str | None:
    """Replace the table by `stored`; return the path of the former table's backup, or None where that was empty.

    With `force` another valve's table is taken too.

    Raises:
        StateError: nothing was changed; the message says why.
    """
    return _ask(directory, messages.ImportRequest(stored, force), messages.Done).backup


def health(directory: Path) -> HealthDocument:
    """Return the health of the valve in the state directory, which need only be readable; the daemon's newest one.

    Raises:
        StateError: there is none, or it cannot be read.
    """
    return from_plain(_ask(directory, HealthRequest(), HealthDumped).document)


def reset_health(directory: Path, sections: tuple[str, ...]) -> str:
    """Begin sections of the health of the valve anew; return the path of the backup.

    Raises:
        StateError: nothing was changed; the message says why.
    """
    return str(_ask(directory, HealthResetRequest(sections), messages.Done).backup)


def change_health(directory: Path, given: dict[str, Any]) -> str:
    """Put these sections in place of the present ones; return the path of the backup.

    Raises:
        StateError: nothing was changed; the message says why.
    """
    return str(_ask(directory, HealthResetRequest(tuple(given), given), messages.Done).backup)


def _ask(directory: Path, request: messages.Request, expected: type[T]) -> T:
    match answer := _answer(directory, request):
        case messages.Refused(reason):
            raise StateError(reason)
        case messages.Rejected(name, fault, detail):
            raise TableRejectedError(directory / name, Fault(fault), detail)
        case expected():
            return answer
    raise StateError(f"{directory}: unexpected answer: {answer}")


def _answer(directory: Path, request: messages.Request) -> messages.Message:
    deadline_s = time.monotonic() + _LOCK_TIMEOUT_S
    while True:
        try:
            with lock.held(directory, timeout_s=0.0):
                return _of_files(directory, request)
        except AlreadyRunningError as occupied:
            try:
                return _of_writer(directory, request)
            except (FileNotFoundError, ConnectionError, PermissionError) as error:
                if isinstance(request, messages.DumpRequest | HealthRequest):  # who may only read cannot connect
                    return _of_files(directory, request)
                if isinstance(error, PermissionError):
                    message = f"{directory / control.NAME}: {error.strerror}; become the daemon's user or its group's"
                    raise StateError(message) from error
                if time.monotonic() > deadline_s:
                    raise occupied from error
        time.sleep(_RETRY_S)


def _of_files(directory: Path, request: messages.Request) -> messages.Message:
    return (as_owner.ask if as_owner.is_needed(directory) else commands.on_files)(directory, request)


def _of_writer(directory: Path, request: messages.Request) -> messages.Message:
    descriptor = os.open(directory, os.O_RDONLY | os.O_DIRECTORY)
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connection:
            connection.settimeout(_ANSWER_S)
            connection.connect(control.address(descriptor))
            channel = Channel(connection)
            channel.send(request)
            answer = next(channel.received_until(time.monotonic() + _ANSWER_S), None)
            if answer is None and channel.ended:
                raise ConnectionAbortedError
    except TimeoutError:
        answer = None
    finally:
        os.close(descriptor)
    if answer is None:
        raise StateError(f"{directory}: the table writer does not answer")
    return answer
