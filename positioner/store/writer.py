"""The table writer: the process that owns the stiction table's files, so that no disk ever delays a control cycle.

The daemon starts it and talks to it over a socket pair; `positioner table` talks to it over `control.sock`. When the
daemon's end of the pair closes, however the daemon ended, it saves and ends. It holds a copy of the descriptor that
holds the directory's lock, so that the next daemon waits until this process no longer writes.
"""

from __future__ import annotations

import math
import os
import select
import socket
import sys
import time
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

from positioner.errors import PositionerError, StateError
from positioner.store import commands, messages
from positioner.store.channel import Channel
from positioner.store.control import ControlSocket
from positioner.store.health_file import HealthFile
from positioner.store.health_keeper import HealthKeeper
from positioner.store.health_messages import HealthRequest, HealthResetRequest, KeepHealth
from positioner.store.table_directory import WRITING_FAILED, TableDirectory, remedy

if TYPE_CHECKING:
    from positioner.store.content import StoredTable

COMMIT_AFTER_S = 0.2
"""Longest time that a sample waits for others to share its transaction."""
_COPY_AFTER_S = 600.0
_RETRY_FIRST_S, _RETRY_LONGEST_S = 0.25, 30.0
_LAST_TRIES_S = 2.0
_RESTARTED = "restarted"


class TableWriter:
    """One valve's table in memory and its way to the disk.

    `now_s` is monotonic; `problem` says why saving fails, or failed before this table writer was started.
    """

    def __init__(
        self,
        channel: Channel,
        tables: TableDirectory,
        stored: StoredTable,
        health: HealthKeeper,
        now_s: float,
        problem: str | None,
    ) -> None:
        self.stored = stored
        self.health = health
        self._channel = channel
        self._tables = tables
        self._acknowledged = (-1, -1)
        self._commit_at_s: float | None = now_s
        self._copy_at_s = now_s
        self._retry_s = _RETRY_FIRST_S
        self.problem = problem

    def due_in(self, now_s: float) -> float | None:
        """Return the seconds until `work` has something to do, or None."""
        due_s = [self.health.due_in(now_s), None if self._commit_at_s is None else self._commit_at_s - now_s]
        return min((max(0.0, each) for each in due_s if each is not None), default=None)

    def handle(self, message: messages.Message, now_s: float) -> None:
        """Take samples from the daemon into memory; samples of another generation are dropped."""
        before = self.stored
        if isinstance(message, messages.Learn) and message.generation == self.stored.generation:
            seconds = int(time.time())
            for sample in message.samples:
                self.stored = self.stored.learned(sample, seconds)
        elif isinstance(message, messages.Adopt) and message.stored.generation >= self.stored.generation:
            self.stored = message.stored
        elif isinstance(message, KeepHealth):
            self.health.take(message)
        elif isinstance(message, messages.Unreadable):
            raise StateError(message.reason)
        if self.stored is not before and self._commit_at_s is None:
            self._commit_at_s = now_s + COMMIT_AFTER_S

    def work(self, now_s: float) -> None:
        """Save the table and the health of the valve, if that is due."""
        if self._commit_at_s is not None and now_s >= self._commit_at_s:
            self.save(now_s)
        self._send_lines(self.health.work(now_s))

    def save(self, now_s: float) -> None:
        """Commit the table, and copy it from time to time; report to the daemon when this fails or works again."""
        try:
            self._tables.save(self.stored)
            self._send_notices()
            self._acknowledge()
            if now_s >= self._copy_at_s:
                self._tables.copy(self.stored)
                self._copy_at_s = now_s + _COPY_AFTER_S
        except WRITING_FAILED as error:
            self._fail(error, now_s)
        else:
            self._succeed()
        self._send_notices()

    def answer(self, request: messages.Message) -> messages.Answer:
        """Return the answer to a request; a reset or an import is on the disk before it is answered."""
        if isinstance(request, messages.DumpRequest):
            return messages.Dumped(self.stored)
        try:
            if isinstance(request, HealthRequest | HealthResetRequest):
                answer = self.health.answer(request, self._send)
                return messages.Done(answer) if isinstance(answer, str) else answer
            replaced = commands.replaced(self._tables, self.stored, request)
        except StateError as error:
            return messages.Refused(str(error))
        self.stored = replaced.stored
        self._send(messages.Replaced(replaced.stored, replaced.reason))
        self._copy_at_s = now_s = time.monotonic()
        self.save(now_s)
        return messages.Done(replaced.backup)

    def finish(self) -> None:
        """Save a last time, trying again for a while."""
        deadline_s = time.monotonic() + _LAST_TRIES_S
        while True:
            self._send_lines(self.health.finish())
            self._copy_at_s = 0.0
            self.save(time.monotonic())
            if (self.problem is None and self.health.problem is None) or time.monotonic() >= deadline_s:
                self._tables.close()
                return
            time.sleep(_RETRY_FIRST_S)

    def _send_notices(self) -> None:
        self._send_lines(self._tables.take_notices())

    def _send_lines(self, lines: tuple[str, ...]) -> None:
        for line in lines:
            self._send(messages.Notice(line))

    def _acknowledge(self) -> None:
        saved = (self.stored.generation, self.stored.table.sequence)
        if saved != self._acknowledged:
            self._acknowledged = saved
            self._send(messages.Saved(*saved))

    def _fail(self, error: Exception, now_s: float) -> None:
        self.problem = f"the stiction table cannot be saved: {remedy(error)}"
        # after each failure: the daemon ends a table writer that is silent for long
        self._send(messages.SavingFailed(self.problem))
        self._commit_at_s = now_s + self._retry_s
        self._retry_s = min(2.0 * self._retry_s, _RETRY_LONGEST_S)

    def _succeed(self) -> None:
        if self.problem is not None:
            self.problem = None
            self._send(messages.SavingWorks())
        self._commit_at_s = None
        self._retry_s = _RETRY_FIRST_S

    def _send(self, message: messages.FromWriter) -> None:
        self._channel.send(message)
        self._channel.flush()


def serve(channel: Channel, writer: TableWriter, control: ControlSocket) -> None:
    """Handle messages and requests as they come, until the daemon sends `Close` or is gone."""
    ready: list[socket.socket | Channel] = []
    while True:
        for message in channel.receive():
            if isinstance(message, messages.Close):
                writer.finish()
                channel.send(messages.Closed(writer.problem or writer.health.problem))
                return
            writer.handle(message, time.monotonic())
        channel.flush()
        control.serve(ready, writer.answer)
        writer.work(time.monotonic())
        if channel.ended:
            writer.finish()
            return
        readers, writers = control.waiting()
        writers = [*writers, *([channel] if channel.pending else [])]
        readable, writable, _ = select.select([channel, *readers], writers, [], writer.due_in(time.monotonic()))
        ready = [one for one in (*readable, *writable) if one is not channel]


def run(channel: Channel, lock: int) -> None:
    """Open the table that the daemon asks for, and serve it.

    Raises:
        StateError: the daemon's first message is not `Open`.
    """
    first = next(channel.received_until(math.inf), None)
    if first is None:
        return
    if not isinstance(first, messages.Open):
        raise StateError(f"not an opening message: {first}")
    tables = TableDirectory(Path(first.directory), first.valve_id, first.cell_width_m)
    health_file = HealthFile(Path(first.directory), first.valve_id)
    try:
        stored = tables.load()
        health = HealthKeeper(health_file, health_file.load())
    except (PositionerError, OSError) as error:
        channel.send(messages.Closed(str(error)))
    else:
        with closing(ControlSocket(lock)) as control:
            notices = (*tables.take_notices(), *control.notices, *health_file.take_notices())
            channel.send(messages.Opened(stored, notices, health.present))
            problem = _RESTARTED if first.restarted else None
            serve(channel, TableWriter(channel, tables, stored, health, time.monotonic(), problem), control)
    channel.flush()
    while channel.pending and not channel.ended:
        channel.wait(_LAST_TRIES_S)
        channel.flush()
        channel.receive()


def main() -> None:
    """Run on the descriptors that the daemon handed over: the channel and the lock."""
    channel, lock = int(sys.argv[1]), int(sys.argv[2])
    if os.sched_getscheduler(0) != os.SCHED_OTHER:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))  # the disk's work yields to the cycle
    run(Channel(socket.socket(fileno=channel)), lock)


if __name__ == "__main__":
    main()
