"""The services under a booted systemd: started, killed, hung, without their bus, misconfigured, stopped."""

from __future__ import annotations

import os
import re
import signal
import time
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import printed
import pytest
from harness.plan import PROJECT
from links import TIMEOUT_S, add_vcan, command, until
from machine import CLOSED_M, CONFIGURATIONS, HIGH_M, LOW_M, Valve, configure, journal, show, systemctl

from positioner.store import document

if TYPE_CHECKING:
    from collections.abc import Iterator

    from positioner.store.content import StoredTable

pytestmark = pytest.mark.kernel("systemd")


@pytest.fixture(scope="module", autouse=True)
def installed() -> None:
    """Install as in docs/install.md, and configure a valve on vcan0."""
    # nothing is compiled: a kernel in user mode takes many minutes for it
    command("env", "POSITIONER_BUILD=pure", "make", "-C", str(PROJECT), "install")
    systemctl("start", "vcan0.service")
    configure("fv101", "vcan0")
    until(lambda: show("sys-subsystem-net-devices-vcan0.device", "ActiveState") == "active", "udev reports vcan0")


@pytest.fixture
def valve() -> Iterator[Valve]:
    """A valve whose loop is closed by its two services."""
    running = Valve("fv101", "vcan0")
    running.start()
    yield running
    running.stop()
    running.port.close()


def table_of(valve: Valve) -> StoredTable:
    """Return the table as root's command line prints it."""
    text = command("/usr/local/bin/positioner", "table", "dump", "--state", str(valve.state), "--format", "json")
    return document.loads(text, "the dump")


def samples_in(valve: Valve) -> int:
    return sum(len(cell.samples) for _, cell in table_of(valve).table)


def test_the_service_is_ready_at_the_first_feedback_and_not_before(valve: Valve) -> None:
    valve.stop()
    systemctl("start", "--no-block", valve.unit)
    until(lambda: printed.WAITING_FOR_FRAMES in show(valve.unit, "StatusText"), valve.story)
    assert show(valve.unit, "ActiveState") == "activating"
    systemctl("start", valve.plant)
    until(lambda: valve.is_active, valve.story)


def test_the_loop_is_closed_and_what_is_learned_belongs_to_a_user_made_for_it(valve: Valve) -> None:
    valve.go_to(LOW_M)
    valve.go_to(HIGH_M)
    valve.go_to(0.080)
    until(lambda: samples_in(valve) > 0, valve.story)
    assert table_of(valve).valve_id == "fv101"
    private = Path("/var/lib/private/positioner/fv101")
    assert private.stat().st_uid not in {0, 65534}
    assert Path(f"/proc/{valve.pid}").stat().st_uid == private.stat().st_uid
    assert oct(private.stat().st_mode & 0o777) == "0o750"


def test_a_killed_positioner_is_back_within_two_seconds_and_keeps_its_table(valve: Valve) -> None:
    valve.go_to(LOW_M)
    valve.go_to(HIGH_M)
    before, killed = samples_in(valve), valve.pid
    killed_s = time.monotonic()
    os.kill(killed, signal.SIGKILL)
    until(lambda: valve.pid not in {0, killed}, valve.story)
    started_s = int(show(valve.unit, "ExecMainStartTimestampMonotonic")) * 1e-6
    assert 0.0 < started_s - killed_s < 2.0
    assert samples_in(valve) >= before
    until(lambda: valve.is_active, valve.story)
    # the actuator failed safe by itself while nobody commanded it
    until(lambda: printed.FAIL_POSITION in journal(valve.plant), valve.story)
    valve.go_to(0.080)


@pytest.mark.slow(short="test_a_killed_positioner_is_back_within_two_seconds_and_keeps_its_table")
def test_the_valve_fails_safe_while_nobody_commands_it(valve: Valve) -> None:
    valve.go_to(HIGH_M)
    systemctl("stop", valve.unit)
    valve.until(lambda: valve.is_at(CLOSED_M, 0.002))
    valve.start()
    valve.go_to(0.080)


def test_a_positioner_that_hangs_is_killed_by_the_watchdog_and_comes_back(valve: Valve) -> None:
    hung, restarts = valve.pid, int(show(valve.unit, "NRestarts"))
    os.kill(hung, signal.SIGSTOP)
    until(lambda: valve.pid not in {0, hung}, valve.story)
    assert int(show(valve.unit, "NRestarts")) == restarts + 1
    assert printed.WATCHDOG in journal(valve.unit)
    until(lambda: valve.is_active, valve.story)
    valve.go_to(HIGH_M)


@contextmanager
def start_within(valve: Valve, limit_s: float) -> Iterator[None]:
    """Stop the positioner, and shorten the time that its unit allows for a start."""
    valve.stop()
    drop_in = Path(f"/run/systemd/system/{valve.unit}.d/start.conf")
    drop_in.parent.mkdir(parents=True, exist_ok=True)
    drop_in.write_text(f"[Service]\nTimeoutStartSec={limit_s}\nTimeoutStopSec=2\n", encoding="utf-8")
    systemctl("daemon-reload")
    try:
        yield
    finally:
        drop_in.unlink()
        systemctl("daemon-reload")


def running_s(valve: Valve) -> float:
    """Return how long the positioner's process has been running."""
    return time.monotonic() - int(show(valve.unit, "ExecMainStartTimestampMonotonic")) * 1e-6


@pytest.mark.slow(short="test_the_service_is_ready_at_the_first_feedback_and_not_before")
def test_a_positioner_waits_for_its_first_feedback_without_end_and_is_killed_if_it_hangs_meanwhile(
    valve: Valve,
) -> None:
    limit_s = 45.0  # a busy kernel in user mode loads the positioner in 15 to 20 s
    with start_within(valve, limit_s):
        killed = journal(valve.unit).count(printed.WATCHDOG)
        systemctl("start", "--no-block", valve.unit)
        until(lambda: valve.pid and running_s(valve) > limit_s + 5.0, valve.story, TIMEOUT_S * 2)
        waiting = valve.pid
        assert printed.WAITING_FOR_FRAMES in show(valve.unit, "StatusText")
        assert show(valve.unit, "ActiveState") == "activating"
        os.kill(waiting, signal.SIGSTOP)
        until(lambda: valve.pid not in {0, waiting}, valve.story, TIMEOUT_S * 2)
    assert journal(valve.unit).count(printed.WATCHDOG) == killed + 1
    systemctl("start", valve.plant)
    until(lambda: valve.is_active, valve.story)


@pytest.mark.slow(short="test_a_positioner_that_hangs_is_killed_by_the_watchdog_and_comes_back")
def test_a_positioner_that_hangs_before_its_first_cycle_is_killed_and_comes_back(valve: Valve) -> None:
    with start_within(valve, 5.0):
        late = journal(valve.unit).count(printed.START_TIMED_OUT)
        systemctl("start", "--no-block", valve.plant, valve.unit)
        until(lambda: valve.pid, valve.story)
        hung = valve.pid
        os.kill(hung, signal.SIGSTOP)
        assert show(valve.unit, "StatusText") == ""
        until(lambda: journal(valve.unit).count(printed.START_TIMED_OUT) > late, valve.story)
    until(lambda: valve.pid not in {0, hung}, valve.story)
    until(lambda: valve.is_active, valve.story, TIMEOUT_S * 2)


@pytest.mark.slow(
    short="project/test_units.py::test_a_positioner_that_crashes_again_and_again_is_restarted_later_and_later_and_never_given_up"
)
def test_a_positioner_that_is_killed_again_and_again_is_not_given_up(valve: Valve) -> None:
    for _ in range(12):
        killed = valve.pid
        os.kill(killed, signal.SIGKILL)
        until(lambda: valve.pid not in {0, killed}, valve.story)  # noqa: B023 - called at once
    until(lambda: valve.is_active, valve.story)
    assert int(show(valve.unit, "NRestarts")) >= 12


@pytest.mark.slow(short="project/test_units.py::test_the_memory_of_the_positioner_is_bounded_and_may_be_locked")
def test_the_memory_of_the_positioner_stays_in_ram_and_within_a_limit(valve: Valve) -> None:
    status = Path(f"/proc/{valve.pid}/status").read_text(encoding="utf-8")
    held = dict(re.findall(r"^(VmLck|VmRSS):\s+(\d+) kB", status, re.MULTILINE))
    assert int(held["VmLck"]) > 0
    most = int(show(valve.unit, "MemoryMax"))
    # several times what it needs
    assert 0.05 * most < int(held["VmRSS"]) * 1024 < 0.4 * most


@pytest.mark.slow(
    short="project/test_units.py::test_the_drop_in_binds_a_service_to_its_interface_and_the_interface_to_it"
)
def test_a_bus_that_is_deleted_and_made_again_brings_the_service_back_by_itself(valve: Valve) -> None:
    systemctl("enable", valve.unit)
    command("ip", "link", "delete", "vcan0")
    until(lambda: show(valve.unit, "ActiveState") in {"inactive", "failed"}, valve.story)
    add_vcan("vcan0")
    until(lambda: valve.is_active, valve.story, TIMEOUT_S * 2)
    valve.go_to(HIGH_M)
    systemctl("disable", valve.unit)


def test_a_wrong_configuration_fails_once_and_says_why() -> None:
    (CONFIGURATIONS / "bad.toml").write_text(
        '[valve]\nid = "bad"\npreset = "paper"\n[control]\nlaw = "nmcp"\n', encoding="utf-8"
    )
    unit = "positioner@bad.service"
    systemctl("start", unit, check=False)
    until(lambda: show(unit, "ActiveState") == "failed")
    assert show(unit, "ExecMainStatus") == "78"
    assert show(unit, "NRestarts") == "0"
    assert printed.DID_YOU_MEAN in journal(unit)
    assert journal(unit).count(printed.DID_YOU_MEAN) == 1


def test_a_stop_is_clean_and_saves_what_was_learned(valve: Valve) -> None:
    valve.go_to(LOW_M)
    valve.go_to(HIGH_M)
    before = samples_in(valve)
    systemctl("stop", valve.unit)
    assert (show(valve.unit, "Result"), show(valve.unit, "ExecMainStatus")) == ("success", "0")
    assert printed.STOPPED_AND_SAVED in journal(valve.unit)
    assert samples_in(valve) >= before


@pytest.mark.slow(short="runtime/test_safety_valves.py::test_another_controller_ends_its_valve_and_not_the_others")
def test_two_valves_on_two_buses_do_not_disturb_each_other(valve: Valve) -> None:
    add_vcan("vcan1")
    configure("fv102", "vcan1")
    other = Valve("fv102", "vcan1")
    other.start()
    try:
        valve.go_to(LOW_M)
        other.go_to(HIGH_M)
        for running, there_m in ((valve, LOW_M), (other, HIGH_M)):
            running.newest.clear()
            running.until(lambda: running.is_at(there_m))  # noqa: B023 - called at once
        assert other.state.exists()
    finally:
        other.stop()
        other.port.close()


@pytest.mark.parametrize("unit", ["positioner@fv101.service", "plant-emulator@fv101.service"])
def test_a_service_is_exposed_to_no_more_than_1_3(unit: str) -> None:
    report = command("systemd-analyze", "security", "--no-pager", "--threshold=13", unit)
    assert printed.EXPOSURE in report
