"""The log whose reader has stopped: no line ever waits, the missing lines are counted and reported."""

from __future__ import annotations

import contextlib
import fcntl
import logging
import os
import pty
import select
import signal
import socket
import subprocess
import sys
import tty
from typing import TYPE_CHECKING

import pytest
from daemon_helpers import TIMEOUT_S, Loop, Service, own_address, write_configuration

from positioner.bench.processes import BenchProcess
from positioner.errors import ExitCode
from positioner.machine import journal
from positioner.machine.line_sink import PIPE_BUF, LineSink
from positioner.wire.messages import Counted, CurrentCommand, Mode, PositionerCount

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path
    from types import FrameType

MANY = 20_000


@pytest.fixture
def _no_write_waits() -> Iterator[None]:
    """Turn a write that waits for its reader into a failure."""

    def waited(_number: int, _frame: FrameType | None) -> None:
        raise AssertionError("something waits for a reader")

    before = signal.signal(signal.SIGALRM, waited)
    signal.setitimer(signal.ITIMER_REAL, TIMEOUT_S / 3.0)
    yield
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    signal.signal(signal.SIGALRM, before)


class Ends:
    """A way to a reader: the end to write to as a stream, and what can be read at the other end at once."""

    def __init__(self, reader: int, writer: int) -> None:
        self.reader, self.stream = reader, os.fdopen(writer, "w")
        self.sinks: list[LineSink] = []
        self.seen = b""

    def read(self) -> list[str]:
        while select.select([self.reader], [], [], 0.0)[0] and (chunk := os.read(self.reader, 1 << 16)):
            self.seen += chunk
        return self.seen.decode().splitlines()

    def sink(self) -> LineSink:
        self.sinks.append(LineSink.of(self.stream))
        return self.sinks[-1]

    def close(self) -> None:
        for sink in self.sinks:
            sink.close()
        self.stream.close()
        with contextlib.suppress(OSError):
            os.close(self.reader)


def pipe() -> Ends:
    return Ends(*os.pipe())


def sockets() -> Ends:
    ours, theirs = socket.socketpair()
    return Ends(ours.detach(), theirs.detach())


def terminal() -> Ends:
    master, slave = pty.openpty()
    tty.setraw(slave)
    return Ends(master, slave)


@pytest.fixture(params=[pipe, sockets, terminal])
def ends(request: pytest.FixtureRequest) -> Iterator[Ends]:
    """A pipe, a pair of sockets or a terminal."""
    made = request.param()
    yield made
    made.close()


def filled(ends: Ends) -> tuple[LineSink, int]:
    """Return a sink that has begun to drop, and how many lines were taken before."""
    sink = ends.sink()
    for number in range(MANY):
        sink.write(f"INFO line {number}")
        if sink.dropped:
            return sink, number
    raise AssertionError("there is no end to what it takes")


@pytest.mark.usefixtures("_no_write_waits")
@pytest.mark.parametrize("reopened", [True, False])
def test_a_line_that_would_wait_is_dropped_and_the_gap_is_reported_when_somebody_reads_again(
    ends: Ends, monkeypatch: pytest.MonkeyPatch, *, reopened: bool
) -> None:
    if not reopened:

        def refused(*_arguments: object) -> int:
            raise PermissionError

        monkeypatch.setattr(os, "open", refused)
    sink, taken = filled(ends)
    for _ in range(9):
        sink.write("WARNING another one")
    assert sink.dropped == 10
    ends.read()
    sink.write("INFO again")
    sink.write("INFO and again")
    lines = ends.read()
    assert lines[: taken - 1] == [f"INFO line {number}" for number in range(taken - 1)]
    missing = int(lines[-3].split()[1])
    assert lines[-3] == f"WARNING {missing} line(s) of the log are missing here: it was not read"
    assert lines[-2:] == ["INFO again", "INFO and again"]
    assert len(lines) - 3 + missing == taken + 10
    assert sink.dropped == missing


def test_the_file_that_others_share_stays_as_it_is(ends: Ends) -> None:
    before = fcntl.fcntl(ends.stream, fcntl.F_GETFL)
    ends.sink().write("INFO a line")
    assert fcntl.fcntl(ends.stream, fcntl.F_GETFL) == before
    assert not before & os.O_NONBLOCK


def test_lines_stay_whole_when_another_process_reads_them_slowly(ends: Ends) -> None:
    sink, _ = filled(ends)
    for number in range(300):
        if select.select([ends.reader], [], [], 0.0)[0]:
            ends.seen += os.read(ends.reader, 97)
        sink.write(f"INFO slow {number}")
    *seen, _ = ends.read()
    assert [line for line in seen if not line.startswith(("INFO line ", "INFO slow ", "WARNING "))] == []


def test_a_reader_that_has_gone_costs_lines_and_nothing_else() -> None:
    ends = pipe()
    os.close(ends.reader)
    sink = ends.sink()
    sink.write("INFO nobody")
    assert sink.dropped == 1
    ends.stream.close()


def test_a_full_disk_costs_lines_and_nothing_else(tmp_path: Path) -> None:
    with open("/dev/full", "w", encoding="ascii") as full:  # noqa: PTH123 - a device
        sink = LineSink.of(full)
        sink.write("INFO lost")
        assert sink.dropped == 1
    with (tmp_path / "log").open("w", encoding="ascii") as file:
        sink = LineSink.of(file)
        for number in range(3000):
            sink.write(f"INFO {number}")
        assert sink.dropped == 0
    assert (tmp_path / "log").read_text(encoding="ascii").splitlines()[-1] == "INFO 2999"


def test_a_line_that_no_pipe_takes_whole_is_cut_and_the_last_line_is_waited_for() -> None:
    ends = pipe()
    sink = ends.sink()
    sink.write("ä" * PIPE_BUF)
    (line,) = ends.read()
    assert line == "ä" * ((PIPE_BUF - 4) // 2) + "…"
    sink.write("x" * 3 * PIPE_BUF, timeout_s=1.0)
    assert ends.read()[1:] == ["x" * 3 * PIPE_BUF]
    sink, _ = filled(ends)
    sink.write("INFO the end", timeout_s=0.01)
    assert sink.dropped == 2
    ends.close()


@pytest.fixture
def _journal_as_before() -> Iterator[None]:
    before = {name: logging.getLogger(name).handlers[:] for name in ("positioner", "py.warnings")}
    yield
    logging.captureWarnings(capture=False)
    for name, handlers in before.items():
        logging.getLogger(name).handlers[:] = handlers


@pytest.mark.bus
@pytest.mark.usefixtures("_journal_as_before")
def test_lines_that_were_dropped_are_counted_on_the_bus(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with Loop(tmp_path, guard={"auto_arm": True}) as loop:
        ends = pipe()
        monkeypatch.setattr("sys.stderr", ends.stream)
        journal.set_up(verbose=False)
        filled(ends)
        for _ in range(5):
            journal.logger.warning("nobody reads this")
        monkeypatch.setattr("positioner.runtime.session._POLL_EVERY_S", 0.0)
        counts: dict[Counted, int] = {}
        for _ in range(100):  # one count behind each status, in turn
            said = loop.sample()
            counts |= {message.counted: message.count for message in said if isinstance(message, PositionerCount)}
        assert 5 <= counts[Counted.LINE_DROPPED] <= journal.dropped_lines()
        ends.close()


def full_pipe(path: Path) -> int:
    """Make a named pipe that takes nothing more, and return a descriptor that keeps it open."""
    os.mkfifo(path)
    descriptor = os.open(path, os.O_RDWR | os.O_NONBLOCK)
    for size in (PIPE_BUF, 1):
        with contextlib.suppress(BlockingIOError):
            while True:
                os.write(descriptor, b"\n" * size)
    return descriptor


@pytest.mark.bus
def test_a_log_that_nobody_reads_keeps_no_daemon_from_controlling_nor_from_ending(tmp_path: Path) -> None:
    descriptor = full_pipe(tmp_path / "daemon.log")
    guard = {"feedback_hold_periods": 500, "feedback_failsafe_periods": 5000}
    with Service(tmp_path, "--verbose", guard=guard) as service:
        service.others.report()
        service.child.wait_for("READY=1")
        service.arm()
        for _ in range(20):
            assert service.next(CurrentCommand).mode is Mode.ACTIVE
        assert service.stop() == ExitCode.OK
    left = os.read(descriptor, 1 << 20)
    assert set(left) == {ord("\n")}
    os.close(descriptor)


@pytest.mark.bus
@pytest.mark.parametrize("program", ["positioner.cli.main", "plant_emulator.cli.main"])
def test_a_command_ends_though_nobody_reads_its_last_line(program: str, tmp_path: Path) -> None:
    descriptor = full_pipe(tmp_path / "log")
    child = BenchProcess(program, ["run", "--config", str(tmp_path / "absent.toml")], tmp_path / "log")
    assert child.process.wait(TIMEOUT_S) == ExitCode.CONFIG
    child.stop()
    os.close(descriptor)


@pytest.mark.bus
@pytest.mark.parametrize("program", ["positioner.cli.main", "plant_emulator.cli.main"])
@pytest.mark.parametrize("redirected", ["1>&-", "0<&- 1>&- 2>&-", "1>&0 2>&0", "1>/dev/full 2>/dev/full"])
def test_a_stop_is_clean_whatever_has_become_of_the_standard_streams(
    program: str, redirected: str, tmp_path: Path
) -> None:
    address = own_address()
    given = f"--config {write_configuration(tmp_path, address)}" if "positioner" in program else f"--bus {address}"
    reader, without_a_reader = os.pipe()
    os.close(reader)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as notified:
        notified.settimeout(0.1)
        notified.bind(str(tmp_path / "notify"))
        process = subprocess.Popen(
            ["sh", "-c", f"exec '{sys.executable}' -m {program} run {given} {redirected}"],
            stdin=without_a_reader,
            env={**os.environ, "NOTIFY_SOCKET": str(tmp_path / "notify")},
        )
        os.close(without_a_reader)
        said = b""
        while b"STATUS" not in said:  # then its loop cycles
            assert process.poll() is None
            with contextlib.suppress(TimeoutError):
                said = notified.recv(4096)
        process.terminate()
        assert process.wait(TIMEOUT_S) == ExitCode.OK


def test_an_output_that_cannot_be_written_is_reported_with_a_status_of_its_own() -> None:
    command = [sys.executable, "-m", "positioner", "check", "--example"]
    with open("/dev/full", "w", encoding="ascii") as full:  # noqa: PTH123 - a device
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == ExitCode.IO
    assert done.stderr == "positioner: nothing more can be written: No space left on device\n"
