"""The table writer and a disk that takes nothing; the clock is the test's."""

from __future__ import annotations

import errno
import socket
import sqlite3
import subprocess
from typing import TYPE_CHECKING, cast

import pytest
from store_helpers import VALVE, series, taught

from positioner.errors import StateError
from positioner.store import messages
from positioner.store.channel import Channel
from positioner.store.child import Child
from positioner.store.client import TableWriterClient
from positioner.store.health_document import HealthDocument
from positioner.store.health_file import HealthFile
from positioner.store.health_keeper import HealthKeeper
from positioner.store.messages import Opened, Saved, SavingFailed, SavingWorks
from positioner.store.writer import TableWriter

if TYPE_CHECKING:
    from pathlib import Path

    from positioner.store.content import StoredTable
    from positioner.store.table_directory import TableDirectory


class Sent:
    """Keeps the messages that the daemon would receive."""

    def __init__(self) -> None:
        self.messages: list[messages.Message] = []

    def send(self, message: messages.Message) -> None:
        self.messages.append(message)

    def flush(self) -> None:
        pass


class Disk:
    """A table directory on a disk that fails while it has an error."""

    def __init__(self, error: Exception | None) -> None:
        self.error = error
        self.saved: list[StoredTable] = []
        self.tries = 0

    def save(self, stored: StoredTable) -> None:
        self.tries += 1
        if self.error is not None:
            raise self.error
        self.saved.append(stored)

    def copy(self, stored: StoredTable) -> None:
        del stored

    def take_notices(self) -> tuple[str, ...]:
        return ()


@pytest.mark.parametrize(
    "error",
    [
        OSError(errno.ENOSPC, "No space left on device"),
        OSError(errno.EIO, "Input/output error"),  # the error of fsync on a failing disk
        sqlite3.OperationalError("disk I/O error"),
        sqlite3.OperationalError("attempt to write a readonly database"),
        StateError("the table cannot be read now"),
    ],
    ids=str,
)
def test_a_save_that_fails_is_reported_once_and_tried_again_ever_less_often_up_to_every_30_s(
    error: Exception, tmp_path: Path
) -> None:
    sent, disk, now_s = Sent(), Disk(error), 1000.0
    health = HealthKeeper(HealthFile(tmp_path, VALVE), HealthDocument(VALVE, ""))
    tables = cast("TableDirectory", disk)
    writer = TableWriter(cast("Channel", sent), tables, taught(series(7)), health, now_s, None)
    waits_s = []
    for tries in range(1, 13):
        writer.work(now_s)
        assert disk.tries == tries
        due_s = writer.due_in(now_s)
        assert due_s is not None
        waits_s.append(due_s)
        writer.work(now_s + 0.9 * due_s)
        assert disk.tries == tries
        now_s += due_s
    assert waits_s == pytest.approx([0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 30.0, 30.0, 30.0, 30.0, 30.0])
    # each failure is sent, or the table writer would count as hanging; the daemon reports the first
    assert len(sent.messages) == 12
    (reported,) = set(sent.messages)
    assert isinstance(reported, SavingFailed)
    ours, theirs = socket.socketpair()
    theirs.sendall(b"".join(messages.encode(each) + b"\n" for each in sent.messages))
    daemon = TableWriterClient(
        tmp_path, -1, Child(subprocess.Popen(["true"]), Channel(ours)), Opened(taught(series(7)), ())
    )
    assert [event for _ in range(12) for event in daemon.poll(now_s)] == [reported]
    daemon._child.end()
    theirs.close()
    assert reported.reason.startswith(
        f"the stiction table cannot be saved: {getattr(error, 'strerror', None) or error}; "
    )
    assert writer.problem == reported.reason

    disk.error = None
    writer.work(now_s)
    assert disk.saved == [taught(series(7))]
    assert sent.messages[12:] == [Saved(0, 7), SavingWorks()]
    assert writer.due_in(now_s) is None
    assert not writer.problem
