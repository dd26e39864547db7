"""The doctor on what a positioner runs in: its scheduling, its unit, its state directory and its table."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from daemon_helpers import own_address, write_configuration
from store_helpers import series, taught

from positioner.cli.main import main
from positioner.config import locations
from positioner.config.locations import Location, location_of
from positioner.config.reader import load_config
from positioner.doctor import scheduling, state_directory
from positioner.doctor.finding import Finding, Level, worst
from positioner.errors import ExitCode
from positioner.store import access
from positioner.store.table_directory import TABLE

VALVE = '[valve]\nid = "FV-101"\npreset = "paper"\n'


def test_the_policy_of_a_process_is_read_from_the_kernel() -> None:
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as child:
        os.sched_setscheduler(child.pid, os.SCHED_BATCH, os.sched_param(0))
        finding = scheduling.of_daemon(child.pid, 0.001, "positioner@fv101")
        slow = scheduling.of_daemon(child.pid, 0.1, None)
        child.communicate(b"\n")
    assert (finding.level, slow.level) == (Level.WARN, Level.OK)
    assert finding.text.startswith(f"process {child.pid}: SCHED_BATCH on processor ")
    assert finding.fix.startswith(f"sudo chrt --fifo --pid 50 {child.pid}  # until its next start; for good: ")
    assert scheduling.of_daemon(child.pid, 0.001, None).text == f"process {child.pid} has just ended"


FIFO = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK


def test_a_real_time_policy_is_fine_at_any_period(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("positioner.doctor.scheduling.os.sched_getscheduler", lambda _pid: FIFO)
    monkeypatch.setattr("positioner.doctor.scheduling.os.sched_getparam", lambda _pid: os.sched_param(50))
    finding = scheduling.of_daemon(os.getpid(), 0.0001, None)
    assert (finding.level, "SCHED_FIFO priority 50 on processor" in finding.text) == (Level.OK, True)


def test_the_path_of_a_configuration_gives_its_unit_and_its_state(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(locations, "CONFIGURATIONS", tmp_path)
    path = tmp_path / "fv101.toml"
    path.write_text(VALVE, encoding="utf-8")
    plain = load_config(path)
    assert location_of(plain, path) == Location(Path("/var/lib/positioner/fv101"), "positioner@fv101")
    assert location_of(plain, path, tmp_path / "x") == Location(tmp_path / "x", "positioner@fv101")
    path.write_text(f'{VALVE}[state]\ndirectory = "{tmp_path}/own"\n', encoding="utf-8")
    assert location_of(load_config(path), path) == Location(tmp_path / "own", "positioner@fv101")
    elsewhere = tmp_path / "below" / "fv101.toml"
    assert location_of(plain, elsewhere) == Location(plain.state_directory.absolute(), None)


def test_every_command_finds_the_table_of_a_service(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(locations, "CONFIGURATIONS", tmp_path)
    monkeypatch.setattr(locations, "SERVICE_STATES", tmp_path / "lib")
    path = tmp_path / "fv101.toml"
    path.write_text(VALVE, encoding="utf-8")
    assert main(["check", str(path)]) == ExitCode.OK
    assert f"state                  {tmp_path}/lib/fv101\n" in capsys.readouterr().out
    assert main(["table", "dump", "--config", str(path)]) != ExitCode.OK
    assert f"{tmp_path}/lib/fv101" in capsys.readouterr().err


def state_found(folder: Path, directory: Path, unit: str | None = None) -> dict[str, Finding]:
    configuration = load_config(write_configuration(folder, own_address()))
    return {finding.subject: finding for finding in state_directory.findings(configuration, Location(directory, unit))}


def test_a_missing_state_directory_is_no_fault_where_it_can_be_made(tmp_path: Path) -> None:
    finding = state_found(tmp_path, tmp_path / "a" / "b")["state"]
    assert (finding.level, finding.text) == (Level.OK, f"{tmp_path}/a/b does not exist yet: the first start makes it")
    (tmp_path / "file").write_text("")
    finding = state_found(tmp_path, tmp_path / "file" / "state")["state"]
    assert (finding.level, finding.fix) == (
        Level.FAIL,
        f"sudo install -d -m 750 -o $(id -un) {tmp_path}/file/state",
    )
    of_unit = state_found(tmp_path, tmp_path / "file" / "state", "positioner@fv101")["state"]
    assert (of_unit.level, "the first start of positioner@fv101 makes it" in of_unit.text) == (Level.OK, True)


def test_the_table_is_counted_like_its_dump(tmp_path: Path) -> None:
    assert state_found(tmp_path, tmp_path)["table"].text == "none yet: nothing has been learned"
    access.replace(tmp_path, taught(series(200)), force=False)
    finding = state_found(tmp_path, tmp_path)["table"]
    assert (finding.level, finding.text) == (Level.OK, "valve FV-101: 200 samples in 30 cells")


def test_a_table_of_another_valve_or_of_other_cells_is_a_warning(tmp_path: Path) -> None:
    for number, stored in enumerate((taught(series(3), "FV-202"), taught(series(3), width_m=0.01))):
        directory = tmp_path / str(number)
        directory.mkdir()
        access.replace(directory, stored, force=True)
        finding = state_found(tmp_path, directory)["table"]
        assert finding.level is Level.WARN
        assert ("this valve is FV-101" if number == 0 else "10 mm, but the configuration says 5 mm") in finding.text


def test_a_damaged_table_fails(tmp_path: Path) -> None:
    (tmp_path / TABLE).write_bytes(b"not a table" * 100)
    finding = state_found(tmp_path, tmp_path)["table"]
    assert (finding.level, "is not an SQLite database" in finding.text) == (Level.FAIL, True)


@pytest.mark.parametrize(
    ("free_mib", "level"), [(0.5, Level.FAIL), (1.5, Level.WARN), (99.0, Level.WARN), (101.0, Level.OK)]
)
def test_the_free_space_sets_the_level(
    free_mib: float, level: Level, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    usage = SimpleNamespace(free=round(free_mib * 2**20))
    monkeypatch.setattr("positioner.doctor.state_directory.shutil.disk_usage", lambda _path: usage)
    assert state_found(tmp_path, tmp_path)["state"].level is level


def test_a_directory_that_cannot_be_written_or_read_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("positioner.doctor.state_directory.os.access", lambda _path, _mode: False)
    found = state_found(tmp_path, tmp_path)
    assert (found["state"].level, "is not writable" in found["state"].text) == (Level.FAIL, True)
    assert (found["table"].level, found["table"].fix[:28]) == (Level.WARN, "sudo positioner table dump -")


def test_the_worst_level_of_no_findings_is_ok() -> None:
    assert worst(()) is Level.OK


def test_a_directory_that_only_root_may_read_is_a_warning(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    configuration = load_config(write_configuration(tmp_path, own_address()))

    def refused(path: Path) -> bool:
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(Path, "is_dir", refused)
    (finding,) = state_directory.findings(configuration, Location(tmp_path, "positioner@fv101"))
    assert (finding.level, finding.text) == (Level.WARN, f"{tmp_path} is not accessible for this user")
    assert finding.fix.startswith(f"sudo ls -l {tmp_path}")
