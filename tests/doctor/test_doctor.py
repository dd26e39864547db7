"""The doctor as a command: what it finds on this machine and about a valve, and how it ends."""

from __future__ import annotations

import contextlib
import json
import re
import threading
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest
from daemon_helpers import Others, Service, own_address, write_configuration
from link_answers import ALL, MCP251X, VCAN0

from positioner.cli.main import main
from positioner.config.reader import load_config
from positioner.doctor import cycle_time, feedback, machine
from positioner.doctor.finding import Finding, Level
from positioner.errors import ExitCode
from positioner.store import lock
from positioner.wire.codec import make_codec
from positioner.wire.messages import CurrentCommand

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

    from positioner.bus.address import BusAddress

    Output = pytest.CaptureFixture[str]

CODEC = make_codec()
VALVE = '[valve]\nid = "FV-101"\npreset = "paper"\n'


@pytest.fixture(autouse=True)
def few_cycles(monkeypatch: pytest.MonkeyPatch) -> None:
    """A few cycles are timed."""
    monkeypatch.setattr(cycle_time, "CYCLES", 10)


@pytest.fixture
def answer(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What `ip` will say; each test may put its own answer there."""
    given = [ALL]

    def run(command: list[str], **_: Any) -> SimpleNamespace:
        assert command[1:] == ["-details", "-statistics", "-json", "link", "show"]
        return SimpleNamespace(stdout=given[0])

    monkeypatch.setattr("positioner.doctor.machine.shutil.which", lambda _name, **_: "/usr/sbin/ip")
    monkeypatch.setattr("positioner.doctor.machine.subprocess.run", run)
    return given


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """A silent bus is listened to for less than a second."""
    monkeypatch.setattr(feedback, "LISTENING_S", 0.05)


def examined(capsys: Output, *arguments: str) -> tuple[int, dict[str, dict[str, str]], dict[str, Any]]:
    """Return the status, the findings by subject (the worse of two) and the whole of `doctor --json`."""
    status = main(["doctor", "--json", *arguments])
    report = json.loads(capsys.readouterr().out)
    ranked = sorted(report["findings"], key=lambda finding: Level[finding["level"]])
    return status, {finding["subject"]: finding for finding in ranked}, report


def by_subject(findings: Iterable[Finding]) -> dict[str, Finding]:
    return {finding.subject: finding for finding in findings}


def configured(folder: Path, **tables: dict[str, Any]) -> Path:
    return write_configuration(folder, own_address(), **tables)


def test_without_a_configuration_the_machine_alone_is_examined(answer: list[str], capsys: Output) -> None:
    answer[0] = VCAN0
    status, found, report = examined(capsys)
    assert (status, report["exit_status"], report["level"]) == (0, 0, "OK")
    assert list(found) == ["timer", "SQLite", "build", "scheduling", "cycle", "interface"]
    assert found["interface"]["text"] == "vcan0 is up (vcan: no bitrate, no controller)"


def test_an_interface_that_no_configuration_needs_never_fails(answer: list[str], capsys: Output) -> None:
    status, found, _ = examined(capsys)
    assert status == ExitCode.OK
    assert (found["interface"]["level"], found["interface"]["text"]) == ("WARN", "vx1 is down")
    answer[0] = "[]"
    status, found, _ = examined(capsys)
    assert (status, found["interface"]["level"]) == (0, "WARN")
    assert found["interface"]["text"] == "this machine has no CAN interface"


def test_a_machine_without_ip_gets_the_command_that_installs_it(
    monkeypatch: pytest.MonkeyPatch, capsys: Output
) -> None:
    monkeypatch.setattr("positioner.doctor.machine.shutil.which", lambda _name, **_: None)
    status, found, _ = examined(capsys)
    assert (status, found["interface"]["level"], found["interface"]["mend"]) == (0, "WARN", "sudo apt install iproute2")


@pytest.mark.parametrize("said", ["state UNKNOWN", "{", "[3]"])
def test_an_ip_without_json_is_reported(said: str, answer: list[str], capsys: Output) -> None:
    answer[0] = said
    status, found, _ = examined(capsys)
    assert (status, found["interface"]["level"]) == (0, "WARN")
    assert "gives no usable answer" in found["interface"]["text"]


def test_the_real_ip_of_this_machine_is_understood_where_there_is_one() -> None:
    links, missing = machine.links()
    if links is None:
        assert [finding.fix for finding in missing] == ["sudo apt install iproute2"]
    else:
        assert "lo" in {link.name for link in links}


def test_a_coarse_timer_and_an_old_sqlite_fail(monkeypatch: pytest.MonkeyPatch) -> None:
    assert machine.timer().level is machine.sqlite().level is Level.OK
    monkeypatch.setattr("positioner.doctor.machine.time.clock_getres", lambda _clock: 0.004)
    assert (machine.timer().level, "4 ms" in machine.timer().text) == (Level.FAIL, True)
    monkeypatch.setattr("positioner.doctor.machine.sqlite3.sqlite_version_info", (3, 11, 9))
    assert machine.sqlite().level is Level.FAIL


def test_a_wrong_configuration_is_reported_line_by_line_with_its_own_status(
    answer: list[str], tmp_path: Path, capsys: Output
) -> None:
    answer[0] = VCAN0
    path = tmp_path / "valve.toml"
    path.write_text(f"{VALVE}mass_kg = 1361\ntravel_maks_m = 0.1\n", encoding="utf-8")
    status, found, report = examined(capsys, "--config", str(path))
    wrong = [finding for finding in report["findings"] if finding["subject"] == "configuration"]
    assert (status, report["exit_status"], [finding["text"][:6] for finding in wrong]) == (78, 78, ["line 4", "line 5"])
    assert {finding["mend"] for finding in wrong} == {f"positioner check {path}"}
    assert "feedback" not in found
    assert examined(capsys, "--config", str(tmp_path / "absent.toml"))[0] == ExitCode.CONFIG


@pytest.mark.usefixtures("short")
def test_a_controller_that_is_too_slow_for_the_period_fails_and_names_the_period(
    answer: list[str], tmp_path: Path, capsys: Output
) -> None:
    answer[0] = MCP251X.replace("500000", "125000")
    path = tmp_path / "valve.toml"
    path.write_text(f'{VALVE}[bus]\nchannel = "can0"\n[state]\ndirectory = "{tmp_path}"\n', encoding="utf-8")
    status, found, _ = examined(capsys, "--config", str(path))
    assert (status, found["bus load"]["level"]) == (ExitCode.FAILURE, "FAIL")
    # 270 bits within what 90 % of 125 kbit/s leave beside 28350 bit/s
    assert f"{270 / (0.9 * 125e3 - 28350):.6f} s" in found["bus load"]["text"]
    assert (found["queue"]["level"], found["restart"]["level"]) == ("WARN", "WARN")


@pytest.mark.usefixtures("answer")
def test_the_counts_come_first_then_each_finding_and_the_commands_that_solve_problems(capsys: Output) -> None:
    main(["doctor"])
    lines = capsys.readouterr().out.splitlines()
    assert re.fullmatch(r"0 FAIL, \d+ WARN, \d+ OK", lines[0])
    assert re.match("OK +timer +the monotonic clock", lines[4])
    assert any(re.fullmatch("WARN +interface +vx1 is down", line) for line in lines)
    assert lines[lines.index("  sudo ip link set vx1 up") - 1] == "WARN interface, fix:"


@contextlib.contextmanager
def reporting(address: BusAddress) -> Iterator[None]:
    """A sensor that reports, and a controller that commands, until the block ends."""
    others, ended = Others(address), threading.Event()

    def talk() -> None:
        while not ended.wait(0.01):
            others.report()
            others.say(CurrentCommand(9.5))

    thread = threading.Thread(target=talk)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
        others.port.close()


@pytest.mark.bus
@pytest.mark.usefixtures("answer")
def test_position_frames_and_another_controller_are_found(
    tmp_path: Path, capsys: Output, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(feedback, "LISTENING_S", 30.0)  # it ends when enough frames came
    path = configured(tmp_path)
    with reporting(load_config(path).bus):
        status, found, _ = examined(capsys, "--config", str(path))
    assert status == ExitCode.OK
    assert found["feedback"]["text"].startswith("stem at 80.00 mm")
    assert found["foreign"]["level"] == "WARN"
    assert "is not a CAN interface" in found["interface"]["text"]
    assert found["daemon"]["text"] == "none runs for this valve"
    assert found["DBC"]["text"] == "the positioner's own, position frames have the identifier 110"
    assert "bus load" not in found


@pytest.mark.bus
@pytest.mark.usefixtures("answer", "short")
def test_a_silent_bus_fails(tmp_path: Path, capsys: Output) -> None:
    status, found, _ = examined(capsys, "--config", str(configured(tmp_path)))
    assert (status, found["feedback"]["level"]) == (ExitCode.FAILURE, "FAIL")
    assert found["feedback"]["text"] == "no valid position frame in 0.05 s; the bus is silent"


def test_a_bus_that_cannot_be_opened_fails_with_the_command_that_fixes_it(
    answer: list[str], tmp_path: Path, capsys: Output
) -> None:
    answer[0] = "[]"
    path = tmp_path / "valve.toml"
    path.write_text(f'{VALVE}[bus]\nchannel = "vcan77"\n[state]\ndirectory = "{tmp_path}"\n', encoding="utf-8")
    status, found, _ = examined(capsys, "--config", str(path))
    assert (status, found["feedback"]["level"]) == (ExitCode.FAILURE, "FAIL")
    assert found["feedback"]["mend"].startswith(("sudo modprobe can-raw", "sudo ip link add dev vcan77 type vcan"))
    assert "vcan77 does not exist" in found["interface"]["text"]


@pytest.mark.bus
@pytest.mark.usefixtures("answer", "short")
def test_the_running_daemon_is_found_by_its_lock(tmp_path: Path, capsys: Output) -> None:
    assert lock.holder(tmp_path / "absent") is None
    with Service(tmp_path) as service:
        service.others.report()
        service.child.wait_for("READY=1")
        assert lock.holder(tmp_path / "state") == service.child.process.pid
        _, found, _ = examined(capsys, "--config", str(service.path))
        assert found["daemon"]["text"].startswith(f"process {service.child.process.pid}: SCHED_")
        assert found["table"]["text"] == "valve FV-101: 0 samples in 0 cells"
        assert "foreign" not in found
        assert service.stop() == ExitCode.OK
    assert lock.holder(tmp_path / "state") is None
