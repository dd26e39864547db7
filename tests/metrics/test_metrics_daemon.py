"""The metrics of a running daemon: where they are, when they go, and that the loop does not feel them."""

from __future__ import annotations

import http.client
import itertools
import logging
import os
import socket
import stat
import sys
import threading
import time
from typing import TYPE_CHECKING, Any

import pytest
from daemon_helpers import TIMEOUT_S, write_configuration
from prometheus_client.openmetrics.parser import text_string_to_metric_families
from virtual_shell import VirtualShell

from positioner.bus.address import BusAddress
from positioner.cli.main import main
from positioner.config.reader import load_valves
from positioner.metrics import writer
from positioner.metrics.exposition import FIRST_LINE, text_of
from positioner.metrics.places import socket_problem
from positioner.metrics.settings import MetricsSettings
from positioner.runtime import metrics as metrics_module
from positioner.runtime.learned_table import LearnedTable
from positioner.runtime.metrics import Metrics, metrics_of
from positioner.store import lock

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from types import FrameType


pytestmark = pytest.mark.bus
SEVERAL = """
[metrics]
file = "shared.prom"
[[valve]]
id = "FV-101"
preset = "paper"
[[valve]]
id = "FV-102"
preset = "paper"
[valve.wire]
id_offset = 128
[valve.metrics]
file = "other.prom"
[[valve]]
id = "FV-103"
preset = "paper"
[valve.wire]
id_offset = 256
"""


def until(done: Callable[[], Any]) -> Any:
    """Return what `done` returns once that is true."""
    end_s = time.monotonic() + TIMEOUT_S
    while time.monotonic() < end_s:
        if found := done():
            return found
        time.sleep(0.01)
    raise AssertionError


def values(text: str) -> dict[str, float]:
    """Return the metrics whose only label is the valve, by their names."""
    read: Any = text_string_to_metric_families
    samples = [sample for family in read(text) for sample in family.samples]
    return {sample.name: sample.value for sample in samples if set(sample.labels) == {"valve"}}


def read_socket(path: Path) -> tuple[str, str]:
    """Return the type and the body of an answer at a Unix socket."""
    connection = http.client.HTTPConnection("localhost")
    connection.sock = socket.socket(socket.AF_UNIX)
    connection.sock.connect(str(path))
    connection.request("GET", "/metrics")
    response = connection.getresponse()
    return str(response.headers["Content-Type"]), response.read().decode()


def test_a_daemon_tells_its_state_in_a_file_and_at_a_socket_until_it_ends(tmp_path: Path) -> None:
    file, place = tmp_path / "positioner.prom", tmp_path / "metrics.sock"
    with VirtualShell(tmp_path, metrics={"file": file.name, "socket": place.name, "every_s": 0.5}) as shell:
        shell.cycle_for(0.2)
        until(file.exists)
        assert stat.S_IMODE(file.stat().st_mode) == 0o644
        assert "positioner_current_amperes" not in values(file.read_text("utf-8"))
        shell.arm()
        shell.cycle_for(1.0)
        told = until(lambda: (found := values(file.read_text("utf-8"))).get("positioner_armed") and found)
        assert told["positioner_setpoint_meters"] == pytest.approx(0.08, abs=1e-5)
        assert told["positioner_position_meters"] == pytest.approx(0.08, abs=1e-5)
        assert 0.004 <= told["positioner_current_amperes"] <= 0.020
        kind, text = read_socket(place)
        assert kind == "application/openmetrics-text; version=1.0.0; charset=utf-8"
        assert values(text).keys() == told.keys()
    until(lambda: not file.exists() and not place.exists())
    assert not list(tmp_path.glob("*.new"))


def test_a_daemon_tells_how_a_law_in_its_shadow_differs(tmp_path: Path) -> None:
    file = tmp_path / "positioner.prom"
    with VirtualShell(tmp_path, control={"shadow": "paper"}, metrics={"file": file.name, "every_s": 0.5}) as shell:
        shell.arm()
        shell.cycle_for(1.0)
        told = until(lambda: file.exists() and (found := values(file.read_text("utf-8"))) and found)
        assert shell.session.shadow is not None
        total = shell.session.shadow.total
        assert total is not None
        assert 10 < told["positioner_shadow_cycles_total"] <= total.cycles
        assert told["positioner_shadow_differing_cycles_total"] <= total.apart
        assert 0.0 < told["positioner_shadow_mean_difference_amperes"] < 0.016


def sent_by(folder: Path, **tables: Any) -> list[Any]:
    folder.mkdir()
    with VirtualShell(folder, **tables) as shell:
        shell.arm()
        shell.cycle_for(1.0)
        return shell.world.sent


def test_the_commands_are_the_same_with_metrics_and_without(tmp_path: Path) -> None:
    without = sent_by(tmp_path / "without")
    assert sent_by(tmp_path / "with", metrics={"file": "metrics.prom", "every_s": 0.5}) == without
    assert len(without) > 100


def instructions(shell: VirtualShell, cycles: int) -> list[tuple[int, int]]:
    """Return for each cycle the interpreter's instructions, and how often metrics were looked at."""
    counts = []
    count = looks = 0

    def trace(frame: FrameType, event: str, argument: object) -> Any:
        nonlocal count, looks
        del argument
        frame.f_trace_opcodes, frame.f_trace_lines = True, False
        count += event == "opcode"
        looks += event == "call" and frame.f_code is Metrics.look.__code__
        return trace

    for _ in range(cycles):
        before, looked = count, looks
        sys.settrace(trace)
        try:
            shell.daemon._cycle()
        finally:
            sys.settrace(None)
        counts.append((count - before, looks - looked))
    return counts


@pytest.mark.interpreted
def test_a_cycle_without_a_hand_over_takes_the_same_instructions(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # When the table writer, a process of its own, answers is chance: its answers are not read here.
    monkeypatch.setattr(LearnedTable, "poll", lambda _: None)
    found = []
    wanted: tuple[tuple[str, Any], ...] = (("without", {}), ("with", {"metrics": {"file": "metrics.prom"}}))
    for name, tables in wanted:
        (tmp_path / name).mkdir()
        with VirtualShell(tmp_path / name, **tables) as shell:
            shell.arm()
            found.append(instructions(shell, 40))
    without, with_metrics = found
    assert all(count > 1000 and not looks for count, looks in without)
    looked = [looks for _, looks in with_metrics]
    assert [own for own, looks in zip(with_metrics, looked, strict=True) if not looks] == [
        other for other, looks in zip(without, looked, strict=True) if not looks
    ]
    assert 3 <= sum(looked) <= 5  # where the daemon reports life, ten times a second: 40 cycles of 10 ms


def test_a_writer_that_is_killed_is_started_again_and_costs_one_line_and_no_command(tmp_path: Path) -> None:
    file = tmp_path / "metrics.prom"
    with VirtualShell(tmp_path, metrics={"file": file.name, "every_s": 0.5}) as shell:
        shell.arm()
        (metrics,) = shell.daemon._metrics
        killed = metrics._process
        assert killed is not None
        killed.kill()
        killed.wait()
        file.unlink(missing_ok=True)
        before = len(shell.world.sent)
        shell.cycle_for(3.0)
        assert len(shell.world.sent) - before >= 300
        (line,) = shell.logged("metrics")
        assert line.endswith("has ended; it is started again in 1 s, and where it ends again, ever later, up to 300 s")
        assert metrics._process is not killed
        until(file.exists)
    until(lambda: not file.exists())


class Ended:
    """A process that has ended at once."""

    def poll(self) -> int:
        return 1


def warnings_of(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return where the warnings of the daemon's metrics come, whatever handlers the process has."""
    told: list[str] = []
    monkeypatch.setattr(logging.getLogger("positioner"), "warning", lambda text, *values: told.append(text % values))
    return told


@pytest.mark.interpreted
def test_the_starts_come_ever_later_and_a_writer_that_lived_long_begins_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept: list[socket.socket] = []
    starts_s: list[float] = []
    now_s = 0.0
    lives = False

    def start(_program: str, *_arguments: str, descriptors: tuple[int, ...]) -> Ended:
        starts_s.append(now_s)
        if lives:
            kept.append(socket.socket(fileno=os.dup(descriptors[0])))
        return Ended()

    def look_until(end_s: float) -> None:
        nonlocal now_s
        while now_s < end_s:
            now_s += 0.5
            metrics.look(now_s)

    monkeypatch.setattr(metrics_module, "shielded", start)
    told = warnings_of(monkeypatch)
    metrics = Metrics(MetricsSettings(file=tmp_path / "metrics.prom", every_s=0.5), ())
    look_until(1200.0)
    assert [later - earlier for earlier, later in itertools.pairwise(starts_s[1:])] == [
        *(2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0, 256.0, 300.0, 300.0)
    ]
    assert starts_s[:2] == [0.0, 1.5]  # its end is seen at the first hand-over
    assert len(told) == 1
    lives = True
    look_until(2200.0)
    (end,) = kept
    assert end.recv(10) == b"[]"
    starts_s.clear()
    lives = False
    end.close()
    look_until(2203.0)
    assert starts_s == [2201.5]
    assert len(told) == 2


@pytest.mark.interpreted
def test_a_start_that_fails_is_told_once_and_tried_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> None:
        raise BlockingIOError(11, "Resource temporarily unavailable")

    told = warnings_of(monkeypatch)
    with monkeypatch.context() as patch:
        patch.setattr(metrics_module, "shielded", full)
        metrics = Metrics(MetricsSettings(file=tmp_path / "metrics.prom"), ())
        for tenth in range(100):
            metrics.look(tenth / 10.0)
    (line,) = told
    assert "the metrics writer cannot be started: [Errno 11]" in line
    metrics.look(100.0)
    until((tmp_path / "metrics.prom").exists)
    metrics.close()
    assert not (tmp_path / "metrics.prom").exists()


@pytest.mark.interpreted
def test_a_defect_ends_the_metrics_with_one_line_and_never_the_loop(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def defect(*_: object) -> None:
        raise KeyError("mode")

    monkeypatch.setattr(metrics_module, "snapshot_of", defect)
    with VirtualShell(tmp_path, metrics={"file": "metrics.prom", "every_s": 0.5}) as shell:
        shell.arm()
        before = len(shell.world.sent)
        shell.cycle_for(3.0)
        assert shell.logged("metrics") == ["metrics: no more until the positioner starts again: 'mode'"]
        assert len(shell.world.sent) - before >= 300


def test_a_place_that_cannot_be_written_is_told_once_and_used_when_it_is_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    folder = tmp_path / "later"
    place = tmp_path / "no-socket"
    place.write_text("mine", "utf-8")
    arguments = (theirs, folder / "metrics.prom", place, "1")
    process = threading.Thread(target=writer.run, args=arguments)
    process.start()
    for _ in range(3):
        ours.send(b"[]")
    folder_problem = until(lambda: capsys.readouterr().err)
    time.sleep(0.05)
    assert folder_problem.count("\n") == 1
    assert f"WARNING metrics: {folder / 'metrics.prom'}: cannot be written: No such file or directory" in folder_problem
    folder.mkdir()
    ours.send(b"[]")
    until((folder / "metrics.prom").exists)
    socket_problem = until(lambda: capsys.readouterr().err)
    assert f"{place}: cannot be used: something else has this name" in socket_problem
    place.unlink()
    ours.send(b"[]")
    assert "INFO metrics: written again" in until(lambda: capsys.readouterr().err)
    assert read_socket(place)[1].endswith("# EOF\n")
    ours.close()
    process.join(10.0)
    theirs.close()
    assert not (folder / "metrics.prom").exists()
    assert not place.exists()


def test_a_full_disk_keeps_the_old_text_and_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "metrics.prom"
    file = writer.MetricsFile(path)
    assert file.write("old\n") is None

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fchmod", full)
    assert "No space left on device" in str(file.write("new\n"))
    assert path.read_text("utf-8") == "old\n"
    assert list(tmp_path.iterdir()) == [path]


def told_by_writer(capsys: pytest.CaptureFixture[str], file: Path | None, place: Path | None) -> str:
    """Let a metrics writer take some snapshots and end; return what it told."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    for _ in range(3):
        ours.send(b"[]")
    ours.close()
    writer.run(theirs, file, place, "1")
    theirs.close()
    return capsys.readouterr().err


def as_it_is(path: Path) -> tuple[Any, ...]:
    status = path.lstat()
    content = path.read_bytes() if stat.S_ISREG(status.st_mode) else b""
    return status.st_ino, status.st_mode, status.st_mtime_ns, content


def test_nothing_of_others_is_replaced_or_removed_where_metrics_are_to_go(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table, foreign, empty, link, folder, pipe = (
        tmp_path / name for name in ("table.sqlite", "node.prom", "lock", "link.prom", "folder", "pipe")
    )
    table.write_bytes(b"SQLite format 3\0" + bytes(100))
    foreign.write_text("# TYPE node_load1 gauge\nnode_load1 0.1\n", "utf-8")
    empty.touch()
    link.symlink_to(table)
    folder.mkdir()
    os.mkfifo(pipe)
    own = tmp_path / "own.prom"
    assert writer.MetricsFile(own).write(text_of([], "1")) is None
    linked_to_own = tmp_path / "linked.prom"
    linked_to_own.symlink_to(own)
    for victim in (table, foreign, empty, link, folder, pipe, linked_to_own):
        before = as_it_is(victim)
        told = told_by_writer(capsys, victim, None)
        assert told.count("\n") == 1, victim
        assert told.startswith(f"WARNING metrics: {victim}: ")
        assert "is left as it is" in told
        assert as_it_is(victim) == before
    assert table.read_bytes().startswith(b"SQLite")
    assert not [each.name for each in tmp_path.iterdir() if each.name.endswith(".new")]


def test_a_daemon_whose_metrics_file_is_its_configuration_or_its_table_spares_both(tmp_path: Path) -> None:
    for number, name in enumerate(("valve.toml", "state/stiction.sqlite", "state/health.json")):
        folder = tmp_path / str(number)
        folder.mkdir()
        with VirtualShell(folder, metrics={"file": name, "every_s": 0.5}) as shell:
            shell.arm()
            shell.cycle_for(1.5)
        victim = folder / name
        if victim.exists():
            assert not victim.read_bytes().startswith(FIRST_LINE)
        assert load_valves(folder / "valve.toml")[0].valve.id == "FV-101"


def test_a_socket_at_which_another_process_answers_stays_its_own(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place = tmp_path / "control.sock"
    with socket.socket(socket.AF_UNIX) as other:
        other.bind(str(place))
        other.listen(1)
        before = as_it_is(place)
        told = told_by_writer(capsys, None, place)
        problem = f"{place}: cannot be used: another process answers there"
        assert told == f"WARNING metrics: {problem}; tried again each time\n"
        assert as_it_is(place) == before
    assert socket_problem(place) is None  # nobody answers any more: it is left over
    assert told_by_writer(capsys, None, place) == ""
    assert not place.exists()


def test_what_others_put_in_the_place_of_the_metrics_meanwhile_stays_at_the_end(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, second = tmp_path / "metrics.prom", writer.MetricsFile(tmp_path / "metrics.prom")
    file = writer.MetricsFile(path)
    text = text_of([], "1")
    assert file.write(text) is None
    assert second.write(text) is None  # what a daemon before has left is ours
    assert str(file.write(text)).startswith(f"{path}: another process writes there, too")
    file.remove()
    assert path.exists()
    path.unlink()
    path.write_text("mine\n", "utf-8")
    second.remove()
    assert path.read_text("utf-8") == "mine\n"
    server = writer.MetricsSocket(tmp_path / "metrics.sock")
    threading.Thread(target=server.serve_forever, daemon=True).start()
    (tmp_path / "metrics.sock").unlink()
    (tmp_path / "metrics.sock").write_text("mine\n", "utf-8")
    server.close()
    assert (tmp_path / "metrics.sock").read_text("utf-8") == "mine\n"
    assert capsys.readouterr().err == ""


def test_check_says_that_something_else_stands_where_the_metrics_are_to_go(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bus = BusAddress(interface="virtual", channel="none")
    page = tmp_path / "page.txt"
    page.write_text("mine\n", "utf-8")
    path = write_configuration(tmp_path, bus, metrics={"file": "valve.toml", "socket": page.name})
    assert main(["check", str(path)]) == 78
    socket_line, file_line = sorted(capsys.readouterr().err.replace("positioner: ", "").splitlines(), reverse=True)
    assert f"metrics.socket = '{page}': something else has this name" in socket_line
    assert f"metrics.file = '{path}': holds something other than our metrics, and is left as it is" in file_line
    path = write_configuration(tmp_path, bus, metrics={"socket": "live.sock"})
    with socket.socket(socket.AF_UNIX) as other:
        other.bind(str(tmp_path / "live.sock"))
        other.listen(1)
        assert main(["check", str(path)]) == 78
        assert "another process answers there" in capsys.readouterr().err
        (tmp_path / "state").mkdir()
        with lock.held(tmp_path / "state", 0.0):  # as the daemon of this valve holds it: the socket is its own
            assert main(["check", str(path)]) == 0


def test_clients_that_only_wait_neither_stop_the_file_nor_keep_others_out_for_long(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(writer, "_PATIENCE_S", 1.0)
    file, place = tmp_path / "metrics.prom", tmp_path / "metrics.sock"
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    process = threading.Thread(target=writer.run, args=(theirs, file, place, "1"))
    process.start()
    ours.send(b"[]")
    until(place.exists)
    waiting = []
    for _ in range(300):
        client = socket.socket(socket.AF_UNIX)
        client.connect(str(place))  # it waits until there is room in the queue
        client.settimeout(TIMEOUT_S)
        waiting.append(client)
    kept = [client for client in waiting if not client.recv(1)]
    assert len(kept) == 300  # those beyond the limit at once, the others when their time was over
    before = file.stat().st_mtime_ns
    ours.send(b"[]")
    until(lambda: file.stat().st_mtime_ns != before)
    assert until(lambda: read_socket(place)[1]).endswith("# EOF\n")
    ours.close()
    process.join(TIMEOUT_S)
    theirs.close()
    for client in waiting:
        client.close()
    assert not place.exists()


def test_the_configuration_says_where_they_go_and_refuses_what_it_does_not_know(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_configuration(
        tmp_path, BusAddress(interface="virtual", channel="none"), metrics={"file": "/run/m.prom", "every_s": 2.0}
    )
    assert main(["check", str(path)]) == 0
    (line,) = [line for line in capsys.readouterr().out.splitlines() if line.split()[:1] == ["metrics"]]
    assert line.split(maxsplit=1)[1] == "/run/m.prom, every 2 s"
    path.write_text(path.read_text("utf-8").replace("every_s = 2.0", "every = 2.0\nport = 9100"), "utf-8")
    assert main(["check", str(path)]) == 78
    problems = capsys.readouterr().err
    assert "metrics.every" in problems
    assert "metrics.port" in problems


def test_valves_that_share_their_places_share_one_writer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[tuple[Path | None, tuple[Any, ...]]] = []
    monkeypatch.setattr(metrics_module, "Metrics", lambda own, sessions: started.append((own.file, tuple(sessions))))
    path = tmp_path / "valves.toml"
    path.write_text(SEVERAL, "utf-8")
    configurations = load_valves(path)
    metrics_of(configurations, [each.valve.id for each in configurations])  # type: ignore[misc]
    shared, other = tmp_path / "shared.prom", tmp_path / "other.prom"
    assert started == [(shared, ("FV-101", "FV-103")), (other, ("FV-102",))]
