from __future__ import annotations

import os
import resource
import select
import signal
import socket
import sqlite3
import subprocess
import time
from contextlib import closing
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest
from store_helpers import VALVE, WIDTH_M, opened, python, sample, series, taught, wait_for

from positioner.errors import AlreadyRunningError, StateError
from positioner.store import access, database, lock
from positioner.store.channel import Channel
from positioner.store.child import Child
from positioner.store.client import TableWriterClient
from positioner.store.messages import Open, Opened, Replaced, Saved, SavingFailed, SavingWorks, encode
from positioner.store.table_directory import GOOD_COPY, TABLE

if TYPE_CHECKING:
    from pathlib import Path

    from positioner.valve.stiction import StictionTable

_DAEMON = """
import select, sys
from itertools import count
from pathlib import Path
from store_helpers import opened, sample
writer, table, _ = opened(Path(sys.argv[1]))
for number in count(table.sequence):
    writer.record([sample(number)])
    writer.poll()
    print(number + 1, flush=True)
    select.select([], [], [], 0.001)
"""


def _on_disk(directory: Path) -> StictionTable:
    return database.read(directory / TABLE).table


def _pid(writer: TableWriterClient) -> int:
    return writer._child.process.pid


def test_a_first_save_that_fails_at_once_is_reported_although_it_comes_with_the_first_answer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def start(_lock: int, _opening: Open) -> Child:
        ours, theirs = socket.socketpair()
        theirs.sendall(b"\n".join((encode(Opened(taught([]), ())), encode(SavingFailed("the disk is full")), b"")))
        theirs.close()
        return Child(subprocess.Popen(["true"]), Channel(ours))

    monkeypatch.setattr("positioner.store.child.start", start)
    writer, _, _ = opened(tmp_path)
    assert [writer.problem] == [None]
    assert writer.poll()[0] == SavingFailed("the disk is full")
    assert writer.problem == "the disk is full"
    writer._child.end()
    os.close(writer._lock)


def test_a_first_start_gives_an_empty_table_without_a_notice(tmp_path: Path) -> None:
    writer, table, notices = opened(tmp_path / "made" / "by" / "us")
    assert (len(table), table.cell_width_m, notices) == (0, WIDTH_M, ())
    assert writer.close(10.0) is None


def test_samples_are_saved_after_a_fifth_of_a_second_and_acknowledged(
    tmp_path: Path, writer: TableWriterClient
) -> None:
    wait_for(writer, lambda: writer.saved)
    started_s = time.monotonic()
    writer.record(series(40))
    assert not writer.saved
    events = wait_for(writer, lambda: writer.saved)
    assert 0.1 < time.monotonic() - started_s < 10.0  # 0.2 s until the commit, and a noisy machine
    assert events[-1] == Saved(0, 40)
    assert _on_disk(tmp_path) == taught(series(40)).table


def test_close_returns_after_everything_is_on_the_disk_and_in_the_good_copy(tmp_path: Path) -> None:
    writer, _, _ = opened(tmp_path)
    writer.record(series(1000))
    assert writer.close(10.0) is None
    assert _on_disk(tmp_path) == database.read(tmp_path / GOOD_COPY).table == taught(series(1000)).table
    again, table, _ = opened(tmp_path)
    assert table == taught(series(1000)).table
    again.close(10.0)


@pytest.mark.parametrize("milliseconds", [5, 60, 250, 400])
def test_a_daemon_killed_while_it_learns_loses_nothing_that_it_had_handed_over(
    tmp_path: Path, milliseconds: int
) -> None:
    with python("-c", _DAEMON, tmp_path) as daemon:
        assert daemon.stdout
        first = daemon.stdout.readline()
        assert first
        select.select([], [], [], milliseconds / 1e3)
        daemon.kill()
        handed_over = int((first + daemon.stdout.read()).split()[-1])
    with lock.held(tmp_path, 10.0):  # its table writer saves, then releases the lock
        table = _on_disk(tmp_path)
    assert handed_over <= table.sequence <= handed_over + 1
    assert table == taught(series(table.sequence)).table


def test_a_table_writer_that_dies_is_started_again_and_loses_nothing(tmp_path: Path, writer: TableWriterClient) -> None:
    count = 0
    for _ in range(2):
        writer.record(series(20, count))
        wait_for(writer, lambda: writer.saved)
        writer.record(series(20, count + 20))
        os.kill(_pid(writer), signal.SIGKILL)
        writer.record(series(20, count + 40))
        events = wait_for(writer, lambda: writer.problem is not None)
        assert isinstance(events[-1], SavingFailed)
        writer.record(series(20, count + 60))
        count += 80
        events = wait_for(writer, lambda: writer.saved)
        assert [event for event in events if isinstance(event, SavingWorks)] == [SavingWorks()]
        assert _on_disk(tmp_path) == taught(series(count)).table


def test_signals_that_end_a_daemon_do_not_end_its_table_writer(writer: TableWriterClient) -> None:
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        os.kill(_pid(writer), number)
    writer.record(series(5))
    assert not any(isinstance(event, SavingFailed) for event in wait_for(writer, lambda: writer.saved))


def test_a_slow_table_writer_gets_everything_later_and_nothing_piles_up(
    tmp_path: Path, writer: TableWriterClient
) -> None:
    wait_for(writer, lambda: writer.saved)
    os.kill(_pid(writer), signal.SIGSTOP)
    longest_s = 0.0
    for number in range(6000):
        started_s = time.thread_time()
        writer.record([sample(number)])
        longest_s = max(longest_s, time.thread_time() - started_s)
    assert writer._behind
    assert len(writer._child.channel._outgoing) < 10_000
    assert longest_s < 0.02
    os.kill(_pid(writer), signal.SIGCONT)
    wait_for(writer, lambda: writer.saved)
    assert _on_disk(tmp_path) == taught(series(6000)).table


def _let_write(pid: int, limit: int) -> None:
    """Limit how far a process may write into a file: what a full disk looks like."""
    resource.prlimit(pid, resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))


def test_a_full_disk_is_reported_once_and_what_was_learned_meanwhile_is_saved_later(
    tmp_path: Path, writer: TableWriterClient
) -> None:
    writer.record(series(10))
    wait_for(writer, lambda: writer.saved)
    _let_write(_pid(writer), 0)
    writer.record(series(10, 10))
    events = wait_for(writer, lambda: writer.problem is not None)
    assert str(writer.problem).startswith("the stiction table cannot be saved: ")
    writer.record(series(10, 20))
    with pytest.raises(StateError, match="nothing was changed, since the table cannot be saved"):
        access.reset(tmp_path)
    assert access.dump(tmp_path).table.sequence == 30
    _let_write(_pid(writer), resource.RLIM_INFINITY)
    events += wait_for(writer, lambda: writer.saved and writer.problem is None)
    assert [type(event) for event in events if not isinstance(event, Saved)] == [SavingFailed, SavingWorks]
    assert _on_disk(tmp_path) == taught(series(30)).table


def test_a_close_without_an_answer_reports_it_in_time(tmp_path: Path) -> None:
    writer, _, _ = opened(tmp_path)
    os.kill(_pid(writer), signal.SIGSTOP)
    writer.record(series(10))
    started_s = time.monotonic()
    assert "samples (up to 10) are not known to be saved: its table writer is silent" in str(writer.close(0.2))
    assert time.monotonic() - started_s < 30.0
    os.kill(_pid(writer), signal.SIGCONT)
    writer._child.process.wait(10.0)
    assert _on_disk(tmp_path) == taught(series(10)).table


def test_a_close_after_the_table_writer_died_still_saves(tmp_path: Path) -> None:
    writer, _, _ = opened(tmp_path)
    os.kill(_pid(writer), signal.SIGKILL)
    writer._child.process.wait()
    writer.record(series(10))
    writer.poll()
    assert writer.close(10.0) is None
    assert _on_disk(tmp_path) == taught(series(10)).table


def test_a_second_daemon_is_refused(tmp_path: Path, writer: TableWriterClient) -> None:
    with pytest.raises(AlreadyRunningError, match=f"in use by process {os.getpid()}"):
        TableWriterClient.open(tmp_path, VALVE, WIDTH_M, timeout_s=0.0)
    assert writer.problem is None


def test_a_reset_reaches_the_daemon_by_itself_and_no_earlier_sample_undoes_it(
    tmp_path: Path, writer: TableWriterClient
) -> None:
    writer.record(series(50))
    access.reset(tmp_path)
    started_s = time.monotonic()
    writer.record(series(5, 50))  # recorded before the daemon could know of the reset
    events: list[object] = []
    while not any(isinstance(event, Replaced) for event in events):
        events.extend(writer.poll())
    assert time.monotonic() - started_s < 30.0
    (replaced,) = (event for event in events if isinstance(event, Replaced))
    assert len(replaced.stored.table) == 0
    assert replaced.reason.startswith(f"reset; the former one is in {tmp_path}/backups/before-reset-")
    writer.record(series(3, 100))
    wait_for(writer, lambda: writer.saved)
    assert _on_disk(tmp_path) == taught(series(3, 100)).table


def test_a_reset_that_a_dying_table_writer_could_not_report_is_not_undone_by_its_successor(
    tmp_path: Path, writer: TableWriterClient
) -> None:
    writer.record(series(50))
    access.reset(tmp_path)
    os.kill(_pid(writer), signal.SIGKILL)
    writer._child.process.wait()
    writer._child.channel.receive()  # the message about the reset is lost
    events = wait_for(writer, lambda: writer.problem is None and writer.saved)
    assert [len(event.stored.table) for event in events if isinstance(event, Replaced)] == [0]
    assert len(_on_disk(tmp_path)) == 0


def test_damage_found_at_the_start_is_reported_and_repaired(tmp_path: Path) -> None:
    database.create(tmp_path / GOOD_COPY, taught(series(8)))
    (tmp_path / TABLE).write_bytes(b"garbage")
    writer, table, notices = opened(tmp_path)
    assert table == taught(series(8)).table
    assert [("using the last good copy" in notice) for notice in notices] == [True]
    events = wait_for(writer, lambda: writer.saved)
    assert any("moved aside to" in str(event) for event in events)
    assert writer.close(10.0) is None
    assert _on_disk(tmp_path) == table


def test_a_path_longer_than_a_socket_address_is_no_obstacle(tmp_path: Path) -> None:
    deep = tmp_path.joinpath(*["a-directory-with-a-long-name"] * 6)
    writer, _, notices = opened(deep)
    assert notices == ()
    assert (deep / "control.sock").stat().st_mode & 0o777 == 0o660
    writer.record(series(3))
    assert wait_for(writer, lambda: writer.saved)
    assert access.dump(deep).table.sequence == 3
    assert writer.close(10.0) is None
    assert not (deep / "control.sock").exists()


def test_a_directory_that_cannot_be_made_is_refused_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(StateError, match=r"^[^\n]*cannot be made: Not a directory; choose another or make it$"):
        opened(tmp_path / "file" / "state")


def test_a_table_that_cannot_be_read_now_is_refused_and_neither_touched_nor_locked(tmp_path: Path) -> None:
    database.create(tmp_path / TABLE, taught(series(8)))
    with closing(sqlite3.connect(tmp_path / TABLE, isolation_level=None)) as other:
        other.execute("BEGIN EXCLUSIVE")
        with pytest.raises(StateError, match=r"cannot be opened: [^\n]*in use by another program; close it$"):
            opened(tmp_path)
    writer, table, notices = opened(tmp_path)
    assert (table, notices) == (taught(series(8)).table, ())
    assert writer.close(10.0) is None


def test_values_that_are_not_finite_are_counted_by_nobody(writer: TableWriterClient) -> None:
    writer.record([replace(sample(1), value=float("nan")), sample(2), replace(sample(3), value=float("inf"))])
    assert wait_for(writer, lambda: writer.saved)[-1] == Saved(0, 1)
