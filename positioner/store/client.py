"""The daemon's side of the table writer: starts it, sends it samples, receives its events, closes it; never waits."""

from __future__ import annotations

import os
import subprocess
import time
from typing import TYPE_CHECKING, Any, Self, TypeAlias

from positioner.errors import StateError
from positioner.store import as_owner, child, lock, messages
from positioner.store.health_client import HealthClient
from positioner.store.health_messages import HealthReplaced
from positioner.store.messages import Notice, Replaced, Saved, SavingFailed, SavingWorks

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from positioner.store.child import Child
    from positioner.valve.stiction import LearnedSample, StictionTable

WriterEvent: TypeAlias = Saved | Replaced | HealthReplaced | SavingFailed | SavingWorks | Notice

_LOCK_TIMEOUT_S = 10.0
"""How long to wait for the lock: an earlier daemon's table writer, or a command, is done by then."""
_RESTART_FIRST_S, _RESTART_LONGEST_S = 0.1, 30.0
_LINES_PER_POLL = 4
_REPORTED_AFTER_S, _ENDED_AFTER_S = 3.0, 90.0
"""Silence of a table writer that has something to save: it commits within half a second, and reports a disk that fails
at least every 30 s."""
_HANGS = "the stiction table is not being saved: its table writer does not answer; the disk may hang"


class TableWriterClient:
    """The table writer as the daemon sees it; `problem` says in one line why the table is not being saved, or is None.

    In each cycle call `record` before `poll`: then samples learned before a reset go to the table that was reset.
    """

    def __init__(self, directory: Path, lock_descriptor: int, process: Child, opened: messages.Opened) -> None:
        self._directory = directory
        self._lock = lock_descriptor
        self._child = process
        self._stored = opened.stored
        self.health = HealthClient(opened.health)
        self._saved = Saved(-1, -1)
        self._behind = False
        self._restart_s = _RESTART_FIRST_S
        self._restart_at_s: float | None = None
        self._silent_since_s: float | None = None
        self.problem: str | None = None
        self._is_closing = False
        self._not_closed: str | None = None

    @classmethod
    def open(
        cls,
        state_dir: Path,
        valve_id: str,
        cell_width_m: float,
        timeout_s: float = _LOCK_TIMEOUT_S,
        report: Callable[[str], object] = lambda _line: None,
    ) -> tuple[Self, StictionTable, tuple[str, ...]]:
        """Return the running table writer, the valve's table, and notices about it, a line each.

        Raises:
            AlreadyRunningError: another process uses the directory, and still did after `timeout_s`;
                `report` has been called at once with the process that it waits for.
            StateError: the directory or its table cannot be used.
        """
        directory = as_owner.own_directory(state_dir.absolute())
        descriptor = lock.acquire(directory, timeout_s, report)
        try:
            process = child.start(descriptor, messages.Open(str(directory), valve_id, cell_width_m, restarted=False))
            opened = child.opened(process)
        except (OSError, StateError) as error:
            os.close(descriptor)
            raise StateError(f"the stiction table cannot be opened: {error}") from error
        return (
            cls(directory, descriptor, process, opened),
            opened.stored.table_at(int(time.time())),
            opened.notices,
        )

    @property
    def saved(self) -> bool:
        """True while every recorded sample is on the disk."""
        return self.problem is None and self._saved == self._newest

    @property
    def _newest(self) -> Saved:
        return Saved(self._stored.generation, self._stored.table.sequence)

    def record(self, samples: Sequence[LearnedSample]) -> None:
        """Hand over samples in the order in which the daemon recorded them; never waits, never raises."""
        seconds, learned = int(time.time()), []
        for sample in samples:
            before, self._stored = self._stored, self._stored.learned(sample, seconds)
            if self._stored is not before:
                learned.append(sample)
        if not learned:
            return
        channel = self._child.channel
        if self._behind or channel.pending or channel.ended:
            self._behind = True  # the table writer is slow or gone: it gets the whole table later; nothing piles up
        else:
            channel.send(messages.Learn(self._stored.generation, tuple(learned)))
            channel.flush()

    def keep_health(self, sections: dict[str, Any]) -> None:
        """Hand over the health of the valve as it is now; never waits, never raises."""
        self.health.keep(sections, self._child.channel)

    def poll(self, now_s: float | None = None) -> tuple[WriterEvent, ...]:
        """Return what has happened since the last call; never waits. `now_s` is monotonic, by default the present."""
        now_s = time.monotonic() if now_s is None else now_s
        channel = self._child.channel
        received = channel.receive(_LINES_PER_POLL)
        events = [event for message in received for event in self._update(message)]
        if channel.ended:
            events.extend(self._revive(now_s))
        else:
            if self._behind and not channel.pending:
                channel.send(messages.Adopt(self._stored))
                self._behind = False
            channel.flush(_LINES_PER_POLL)
            events.extend(self._watch(now_s, silent=not received))
        return tuple(events)

    def begin_close(self) -> None:
        """Ask the table writer to save everything and to end; `close` waits for it."""
        self._is_closing = True
        try:
            if self._child.channel.ended:
                self._child.end()
                self._start_again()
            if self._behind:
                self._child.channel.send(messages.Adopt(self._stored))
            self.health.resend(self._child.channel)
            self._child.channel.send(messages.Close())
            self._child.channel.flush()
        except OSError as error:
            self._not_closed = f"the stiction table is not saved: its table writer cannot be started: {error}"

    def close(self, timeout_s: float) -> str | None:
        """Save everything and end the table writer; return why that failed, or None.

        It takes at most `timeout_s`. A table writer that needs longer goes on without the daemon, and keeps the lock.
        """
        deadline_s = time.monotonic() + timeout_s
        if not self._is_closing:
            self.begin_close()
        problem = self._not_closed or self._receive_closed(deadline_s)
        self._child.channel.close()
        os.close(self._lock)
        try:
            self._child.process.wait(max(0.0, deadline_s - time.monotonic()))
        except subprocess.TimeoutExpired:
            return problem or f"the table writer (process {self._child.process.pid}) does not end"
        return problem

    def _receive_closed(self, deadline_s: float) -> str | None:
        for message in self._child.channel.received_until(deadline_s):
            if isinstance(message, messages.Closed):
                return message.problem
            tuple(self._update(message))
        if self.saved:
            return None
        samples = f"the stiction table's newest samples (up to {self._newest.sequence - max(0, self._saved.sequence)})"
        return f"{samples} are not known to be saved: its table writer is silent"

    def _update(self, message: messages.Message) -> Iterator[WriterEvent]:
        match message:
            case Saved():
                self._saved = message
                self._restart_s = _RESTART_FIRST_S
                yield message
            case SavingWorks():
                self.problem = None
                yield message
            case Replaced():
                self._stored, self._behind = message.stored, False
                yield message
            case SavingFailed(reason) | messages.Closed(str(reason)):
                if reason != self.problem:
                    self.problem = reason
                    yield SavingFailed(reason)
            case Notice():
                yield message
            case HealthReplaced():
                yield from self.health.replaced(message)
            case messages.Opened():
                yield from self._adopted(message)
            case messages.Unreadable():
                self._child.process.kill()  # it is not this program's; the next one gets the whole table

    def _adopted(self, opened: messages.Opened) -> Iterator[WriterEvent]:
        """Take what a new table writer found on the disk, where it is of a later generation."""
        yield from map(Notice, opened.notices)
        yield from self.health.replaced(opened.health)
        if opened.stored.generation > self._stored.generation:
            self._stored, self._behind = opened.stored, False
            yield Replaced(opened.stored, "reset or import, just before the table writer ended")

    def _watch(self, now_s: float, *, silent: bool) -> Iterator[WriterEvent]:
        """Report that the table writer has not saved its samples, and end it when it has been silent for long."""
        if not silent or self._saved == self._newest:
            if self.problem == _HANGS and self._saved == self._newest:
                self.problem = None
                yield SavingWorks()
            self._silent_since_s = None
            return
        if self._silent_since_s is None:
            self._silent_since_s = now_s
        silent_s = now_s - self._silent_since_s
        if silent_s > _REPORTED_AFTER_S and self.problem is None:
            self.problem = _HANGS
            yield SavingFailed(_HANGS)
        if silent_s > _ENDED_AFTER_S:
            self._child.process.kill()  # the next one gets its samples again, and its transaction is rolled back

    def _revive(self, now_s: float) -> Iterator[WriterEvent]:
        """Start the table writer again once it is surely gone: there must never be two."""
        if self._restart_at_s is None:
            self._child.process.kill()
            self._restart_at_s = now_s + self._restart_s
            self._restart_s = min(2.0 * self._restart_s, _RESTART_LONGEST_S)
            if self.problem is None:
                self.problem = "the table writer ended unexpectedly; it is being started again"
                yield SavingFailed(self.problem)
        elif now_s >= self._restart_at_s and self._child.process.poll() is not None:
            self._restart_at_s = None
            self._child.channel.close()
            try:
                self._start_again()
            except OSError as error:
                self._restart_at_s = now_s + self._restart_s
                yield Notice(f"the table writer cannot be started: {error}")

    def _start_again(self) -> None:
        table = self._stored.table
        opening = messages.Open(str(self._directory), self._stored.valve_id, table.cell_width_m, restarted=True)
        self._child = child.start(self._lock, opening)
        self.health.resend(self._child.channel)
        self._behind, self._silent_since_s = True, None
