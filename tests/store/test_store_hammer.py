"""`positioner table` and a table writer at one table: what was learned is in the table or in a backup."""

from __future__ import annotations

import select
import subprocess
import time
from typing import TYPE_CHECKING

from store_helpers import opened, python, sample, wait_for

from positioner.store import database, document
from positioner.store.messages import Replaced
from positioner.store.table_directory import BACKUPS, TABLE

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from positioner.store.client import TableWriterClient, WriterEvent
    from positioner.store.content import StoredTable
    from positioner.valve.stiction import StictionTable

_LONG_S = 900.0


class User:
    """Somebody who gives one command of `positioner table` after the other."""

    def __init__(self, state: Path, commands: Iterable[list[str]]) -> None:
        self._state = state
        self._commands = iter(commands)
        self._process: subprocess.Popen[str] | None = None
        self.started_ns = 0
        self.outputs: list[str] = []

    def is_busy(self) -> bool:
        """Return whether the last command still runs; one that failed fails the test."""
        if self._process is None:
            return False
        if self._process.poll() is None:
            return True
        output, _ = self._process.communicate()
        assert self._process.returncode == 0, output
        self.outputs.append(output)
        self._process = None
        return False

    def go_on(self) -> bool:
        """Give the next command; return False where there is none."""
        command = next(self._commands, None)
        if command is None:
            return False
        self.started_ns = time.monotonic_ns()
        arguments = ("-m", "positioner.cli.main", "table", *command, "--state", self._state)
        self._process = python(*arguments, stderr=subprocess.STDOUT)
        return True


class Learner:
    """The daemon's half: it records all the time, and notes what it recorded in each generation of the table."""

    def __init__(self, writer: TableWriterClient, table: StictionTable) -> None:
        self._writer = writer
        self._generation = 0
        self._number = 0
        self._started = {0: table}
        self._recorded: dict[int, list[int]] = {0: []}
        self._recorded_ns: dict[int, list[int]] = {0: []}
        self._replaced_ns: dict[int, int] = {}

    @property
    def replacements(self) -> int:
        return len(self._replaced_ns)

    def record(self) -> None:
        self._recorded_ns[self._generation].append(time.monotonic_ns())
        self._recorded[self._generation].append(self._number)
        self._writer.record([sample(self._number)])
        self._number += 1

    def update(self, events: Iterable[WriterEvent], commanded_ns: int) -> None:
        """Take over the table that a command given at `commanded_ns` put in place."""
        for event in events:
            if isinstance(event, Replaced):
                self._replaced_ns[self._generation] = commanded_ns
                self._generation = event.stored.generation
                self._started[self._generation] = event.stored.table
                self._recorded[self._generation], self._recorded_ns[self._generation] = [], []

    def check(self, stored: StoredTable) -> int:
        """Check that the table is what its generation recorded up to some moment; return how many came later."""
        table = self._started[stored.generation]
        numbers = self._recorded[stored.generation]
        count = stored.table.sequence - table.sequence
        for number in numbers[:count]:
            one = sample(number)
            table = table.learned(one)
        assert stored.table == table
        return len(numbers) - count

    def check_replaced(self, stored: StoredTable) -> None:
        """Check that the backup of a command lacks only samples that were recorded after the command was given."""
        missing = self.check(stored)
        later_ns = self._recorded_ns[stored.generation][len(self._recorded[stored.generation]) - missing :]
        assert all(recorded_ns >= self._replaced_ns[stored.generation] for recorded_ns in later_ns)


def test_commands_hammering_at_a_table_writer_that_records_lose_nothing(tmp_path: Path) -> None:
    state, exports = tmp_path / "state", [tmp_path / f"{number}.json" for number in range(4)]
    changer = User(
        state,
        [
            command
            for path in exports[:2]
            for command in (["export", str(path)], ["reset", "--yes"], ["import", str(path)])
        ],
    )
    reader = User(
        state, [command for path in exports[2:] for command in (["dump", "--format", "json"], ["export", str(path)])]
    )
    writer, table, _ = opened(state)
    learner = Learner(writer, table)
    working = {changer, reader}
    deadline_s = time.monotonic() + _LONG_S
    while working:
        assert time.monotonic() < deadline_s, (changer.outputs, reader.outputs)
        learner.record()
        idle = [user for user in working if not user.is_busy()]
        learner.update(writer.poll(), changer.started_ns)  # the effect of a finished command, before the next one
        working -= {user for user in idle if not user.go_on()}
        select.select([], [], [], 0.002)
    learner.update(wait_for(writer, lambda: writer.saved, _LONG_S), changer.started_ns)
    assert writer.close(_LONG_S) is None

    assert learner.replacements == 4
    assert learner.check(database.read(state / TABLE)) == 0
    backups = [document.loads(path.read_text(encoding="utf-8"), path.name) for path in (state / BACKUPS).iterdir()]
    assert sorted(stored.generation for stored in backups) == list(range(4))
    for stored in backups:
        learner.check_replaced(stored)
    dumps = [text for text in reader.outputs if text.startswith("{")]
    assert len(dumps) == 2
    for text in (*dumps, *(path.read_text(encoding="utf-8") for path in exports)):
        learner.check(document.loads(text, "a dump or an export"))
