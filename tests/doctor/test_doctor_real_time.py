"""The doctor on what makes commands late: clock rates, limits, memory, timers and processors."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import pytest
from daemon_helpers import own_address, write_configuration

from positioner.doctor import real_time, scheduling
from positioner.doctor.examination import Examination
from positioner.doctor.finding import Finding, Level

if TYPE_CHECKING:
    from pathlib import Path

PID = 4711
UNIT = "positioner@fv101"


@pytest.fixture
def files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A machine of files: /proc/4711, /proc/sys/kernel and /sys/devices/system/cpu are folders in it."""
    for name in (str(PID), "kernel", "cpu/cpu0/cpufreq", "cpu/cpu1/cpufreq"):
        (tmp_path / name).mkdir(parents=True)
    monkeypatch.setattr(real_time, "_PROCESSES", tmp_path)
    monkeypatch.setattr(real_time, "_KERNEL", tmp_path / "kernel")
    monkeypatch.setattr(real_time, "_PROCESSORS", tmp_path / "cpu")
    monkeypatch.setattr(os, "sched_getaffinity", lambda _pid: {0, 1})
    monkeypatch.setattr(real_time, "is_real_time", lambda _pid: False)
    write(tmp_path / "kernel/sched_rt_runtime_us", "950000")
    write(tmp_path / "kernel/sched_rt_period_us", "1000000")
    write(tmp_path / f"{PID}/status", "Name:\tpositioner\nVmLck:\t  104448 kB\n")
    return tmp_path


def write(path: Path, text: str) -> None:
    path.write_text(f"{text}\n", encoding="ascii")


def of_machine() -> dict[str, Finding]:
    return {finding.subject: finding for finding in real_time.of_machine()}


def of_daemon(unit: str | None = UNIT) -> dict[str, Finding]:
    return {finding.subject: finding for finding in real_time.of_daemon(PID, unit)}


def test_a_machine_that_is_well_set_up_has_no_warning(files: Path) -> None:
    for name in ("cpu0", "cpu1"):
        write(files / "cpu" / name / "cpufreq/scaling_governor", "performance")
    found = [*of_machine().values(), *of_daemon().values()]
    assert [finding.level for finding in found] == [Level.OK] * 3
    assert [finding.text for finding in found] == [
        "performance", "real-time processes may use 95% of each second", "102 MiB are locked in RAM",
    ]  # fmt: skip


def test_a_governor_that_saves_power_is_named_with_the_command_that_changes_it(files: Path) -> None:
    write(files / "cpu/cpu0/cpufreq/scaling_governor", "performance")
    write(files / "cpu/cpu1/cpufreq/scaling_governor", "powersave")
    finding = of_machine()["governor"]
    assert (finding.level, "'powersave'" in finding.text) == (Level.WARN, True)
    assert finding.fix == "echo performance | sudo tee /sys/devices/system/cpu/cpu*/cpufreq/scaling_governor"


@pytest.mark.parametrize(("limit", "level"), [("400000", Level.WARN), ("500000", Level.OK), ("-1", Level.OK)])
def test_a_limit_that_stops_real_time_processes_early_is_a_warning(limit: str, level: Level, files: Path) -> None:
    write(files / "kernel/sched_rt_runtime_us", limit)
    assert of_machine()["throttling"].level is level


def test_a_kernel_without_the_limit_has_no_finding_on_it(files: Path) -> None:
    (files / "kernel/sched_rt_runtime_us").unlink()
    assert set(of_machine()) == {"governor"}
    assert of_machine()["governor"].level is Level.OK


@pytest.mark.parametrize(
    ("unit", "fix"),
    [
        (UNIT, f"sudo systemctl edit {UNIT}  # LimitMEMLOCK=infinity, and start it again"),
        (None, "ulimit -l unlimited  # before its start"),
    ],
)
def test_memory_that_is_not_locked_is_a_warning(unit: str | None, fix: str, files: Path) -> None:
    write(files / f"{PID}/status", "VmLck:\t       0 kB")
    finding = of_daemon(unit)["memory"]
    assert (finding.level, finding.fix) == (Level.WARN, fix)


@pytest.mark.parametrize(
    ("slack_ns", "real_time_policy", "found"), [(50000, False, True), (50000, True, False), (1000, False, False)]
)
def test_timer_slack_matters_in_time_sharing(
    slack_ns: int, real_time_policy: bool, found: bool, files: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(real_time, "is_real_time", lambda _pid: real_time_policy)
    write(files / f"{PID}/timerslack_ns", str(slack_ns))
    assert ("timer slack" in of_daemon()) is found
    if found:
        finding = of_daemon()["timer slack"]
        assert finding.text == "the kernel may wake it 50 µs late"
        assert finding.fix.startswith(f"echo 1 | sudo tee /proc/{PID}/timerslack_ns  # for good: ")
        assert "#" not in of_daemon(None)["timer slack"].fix


@pytest.mark.parametrize(
    ("isolated", "runs_on", "found"), [("1", {0, 1}, True), ("1-2,5", {2, 5}, False), ("", {0}, False)]
)
def test_a_processor_that_is_kept_free_is_to_be_used(
    isolated: str, runs_on: set[int], found: bool, files: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _pid: runs_on)
    write(files / "cpu/isolated", isolated)
    assert ("affinity" in of_daemon()) is found
    if found:
        assert of_daemon()["affinity"].fix.startswith(f"sudo taskset --cpu-list --pid 1 {PID}  # for good: ")


def test_a_daemon_that_has_ended_and_none_at_all_have_no_findings(files: Path) -> None:
    del files
    assert list(real_time.of_daemon(None, UNIT)) == []
    assert list(real_time.of_daemon(2**22 + 7, UNIT)) == []
    assert scheduling.is_real_time(2**22 + 7)
    assert not scheduling.is_real_time(os.getpid())


@pytest.mark.parametrize(("period_s", "found"), [(0.001, True), (0.05, False)])
def test_only_a_short_period_needs_the_recipe(period_s: float, found: bool, tmp_path: Path) -> None:
    path = write_configuration(tmp_path, own_address(), control={"sample_period_s": period_s})
    subjects = {finding.subject for finding in Examination(path)._examine() if finding.subject != "feedback"}
    assert ("governor" in subjects) is found
