"""A disk that fails: the loop goes on, the status reports it, and nothing is lost once the disk works again."""

from __future__ import annotations

import os
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from daemon_helpers import Loop
from store_helpers import opened, series, taught, wait_for
from test_daemon_state import AUTO, LEARNING, statuses, teach

from positioner.store import child, database
from positioner.store.messages import Saved, SavingFailed, SavingWorks
from positioner.store.table_directory import TABLE
from positioner.wire.messages import CurrentCommand, Health

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

_LONG_S = 300.0
"""The table writer tries again after up to 30 s; a busy machine takes longer for everything."""
FAULTS = {
    "full": "database or disk is full; free some space on the disk",
    "fsync": "disk I/O error; check the disk",
    "no-rights": "make the state directory writable",
}


class Disk:
    """A place for a state directory, and whether its disk works."""

    def __init__(self, place: Path) -> None:
        self.state = place / "state"
        self.state.mkdir()
        self.fault, self._refused = place / "fault", place / "refused"
        self.fault.write_text("", encoding="ascii")
        self._refused.touch()
        self._refused.chmod(0o666)

    @property
    def refused(self) -> int:
        """How many attempts to write have failed."""
        return self._refused.stat().st_size

    def fail(self, how: str) -> None:
        if how == "no-rights":
            self.state.chmod(0o555)
        self.fault.write_text(how, encoding="ascii")

    def work(self) -> None:
        self.state.chmod(0o755)
        self.fault.write_text("", encoding="ascii")


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> Iterator[Disk]:
    """A disk that may fail, not below a directory that only its owner may enter."""
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        place.chmod(0o755)
        one = Disk(place)
        monkeypatch.setattr(child, "PROGRAM", "faulty_writer")
        monkeypatch.setenv("WRITER_FAULT", str(one.fault))
        monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, sys.path)))
        yield one
        one.work()


@pytest.mark.parametrize(("how", "words"), FAULTS.items())
def test_a_disk_that_fails_is_reported_once_and_what_was_learned_meanwhile_is_saved_later(
    disk: Disk, how: str, words: str
) -> None:
    writer, _, _ = opened(disk.state)
    writer.record(series(10))
    wait_for(writer, lambda: writer.saved, _LONG_S)
    disk.fail(how)
    writer.record(series(10, 10))
    events = wait_for(writer, lambda: writer.problem is not None, _LONG_S)
    assert str(writer.problem).startswith("the stiction table cannot be saved: ")
    assert str(writer.problem).endswith(words)
    writer.record(series(10, 20))
    before = disk.refused
    # it goes on trying, whether there are new samples or not
    events += wait_for(writer, lambda: disk.refused >= before + 3, _LONG_S)
    assert not writer.saved
    assert database.read(disk.state / TABLE).table == taught(series(10)).table
    disk.work()
    events += wait_for(writer, lambda: writer.saved, _LONG_S)
    assert [type(event) for event in events if not isinstance(event, Saved)] == [SavingFailed, SavingWorks]
    assert writer.close(_LONG_S) is None
    assert database.read(disk.state / TABLE).table == taught(series(30)).table


@pytest.mark.parametrize("how", FAULTS)
def test_a_start_on_a_disk_that_fails_learns_all_the_same_and_saves_it_later(disk: Disk, how: str) -> None:
    disk.fail(how)
    writer, table, _ = opened(disk.state)
    assert len(table) == 0
    writer.record(series(10))
    wait_for(writer, lambda: writer.problem is not None, _LONG_S)
    disk.work()
    wait_for(writer, lambda: writer.saved, _LONG_S)
    assert writer.close(_LONG_S) is None
    assert database.read(disk.state / TABLE).table == taught(series(10)).table


@pytest.mark.parametrize("how", FAULTS)
def test_a_close_on_a_disk_that_fails_says_so_and_leaves_the_former_table_whole(disk: Disk, how: str) -> None:
    writer, _, _ = opened(disk.state)
    writer.record(series(10))
    wait_for(writer, lambda: writer.saved, _LONG_S)
    disk.fail(how)
    writer.record(series(10, 10))
    assert str(writer.close(_LONG_S)).startswith("the stiction table cannot be saved: ")
    disk.work()
    again, table, notices = opened(disk.state)
    assert (table, notices) == (taught(series(10)).table, ())
    again.close(_LONG_S)


def sample_until(loop: Loop, done: Callable[[], bool]) -> None:
    """Let samples pass until `done` returns True."""
    deadline_s = time.monotonic() + _LONG_S
    while not done():
        assert time.monotonic() < deadline_s, loop.lines
        loop.sample()


@pytest.mark.bus
@pytest.mark.parametrize("how", FAULTS)
def test_the_status_says_that_the_disk_fails_while_the_loop_goes_on_and_until_it_works(
    disk: Disk, tmp_path: Path, how: str
) -> None:
    with Loop(tmp_path, guard=AUTO, control=LEARNING, state={"directory": str(disk.state)}) as loop:
        teach(loop)
        sample_until(loop, lambda: loop.session.table.writer.saved)
        disk.fail(how)
        teach(loop)
        sample_until(loop, lambda: bool(loop.logged("cannot be saved")))
        before = loop.session.state.table.sequence
        teach(loop)
        assert loop.session.state.table.sequence > before
        shown = statuses(loop, 2)[-1]
        assert (shown.table_saved, shown.health) == (False, Health.MAINTENANCE_REQUIRED)
        assert len(loop.logged("cannot be saved")) == 1
        assert any(isinstance(message, CurrentCommand) for message in loop.sample())
        disk.work()
        sample_until(loop, lambda: bool(loop.logged("saved again")))
        sample_until(loop, lambda: loop.session.table.writer.saved)
        shown = statuses(loop, 2)[-1]
        assert (shown.table_saved, shown.health) == (True, Health.GOOD)
    assert database.read(disk.state / TABLE).table == loop.session.state.table
