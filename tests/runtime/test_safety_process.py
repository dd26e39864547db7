"""How the daemon ends, and what the service manager does when it does not end by itself."""

from __future__ import annotations

import configparser
import gc
import signal
import time
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING

import pytest
from daemon_helpers import HERE_M, PERIOD_S, Loop

from positioner.bus.port import BusPort
from positioner.errors import ExitCode
from positioner.runtime import session
from positioner.runtime.service import WATCHDOG_EVERY_S
from positioner.store import access

if TYPE_CHECKING:
    from collections.abc import Iterator

UNIT = Path(__file__).resolve().parents[2] / "systemd" / "positioner@.service"


@pytest.fixture
def service() -> configparser.SectionProxy:
    """The [Service] section of the unit; a key that stands twice keeps its last value."""
    unit = configparser.ConfigParser(interpolation=None, strict=False, comment_prefixes=("#",))
    unit.read_string(UNIT.read_text(encoding="utf-8"))
    return unit["Service"]


@pytest.fixture
def _signals_and_collection_as_before() -> Iterator[None]:
    """Undo what `Daemon.run` does to its process."""
    before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)
    gc.enable()
    gc.unfreeze()


@pytest.mark.bus
@pytest.mark.usefixtures("_signals_and_collection_as_before")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_to_stop_ends_the_loop_after_the_cycle_and_saves_the_table(
    number: signal.Signals, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # the law `paper` learns from any motion, also from one that no current could have caused
    with Loop(tmp_path, guard={"auto_arm": True}, control={"law": "paper"}) as loop:
        for sample in range(80):
            loop.sample(HERE_M + 0.001 * min(sample, 30, max(60 - sample, 0)), setpoint_m=0.1)
        cycles = []

        def cycle() -> None:
            cycles.append("begun")
            assert len(cycles) < 4, "the loop goes on"
            if len(cycles) == 2:
                signal.raise_signal(number)
            cycles[-1] = "done"

        monkeypatch.setattr(loop.daemon, "_cycle", cycle)
        monkeypatch.setattr(session, "CLOSE_TIMEOUT_S", 60.0)  # a busy machine
        loop._running = None
        assert loop.daemon.run() is ExitCode.OK
        assert cycles == ["done", "done"]
        assert loop.lines[-1] == "stopped; the stiction table is saved"
        table = access.dump(tmp_path / "state").table
        assert table == loop.session.state.table
        assert table.sequence > 0


@pytest.mark.bus
def test_a_cycle_that_takes_longer_than_a_period_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with Loop(tmp_path, guard={"auto_arm": True}) as loop:
        gap = SimpleNamespace(gap_ns=round(0.9 * PERIOD_S * 1e9))
        monkeypatch.setattr(Loop, "is_real", True)
        monkeypatch.setattr(BusPort, "gap_ns", property(lambda _port: gap.gap_ns))
        loop.elapsed_ns = time.monotonic_ns()
        loop.sample()
        assert not loop.logged("longer than the period")
        gap.gap_ns = round(1.1 * PERIOD_S * 1e9)
        loop.sample()
        (line,) = loop.logged("longer than the period")
        assert line.startswith("a cycle took 22 ms, longer than the period of 20 ms")


def seconds(span: str | None) -> float:
    """Return a time span of the unit in seconds; 0 where there is none."""
    number, milli, _ = (span or "0").partition("ms")
    return float(number) * (1e-3 if milli else 1.0)


def test_the_service_manager_restarts_a_daemon_that_hangs_or_crashes(service: configparser.SectionProxy) -> None:
    assert service["Type"] == "notify"
    assert 10.0 * WATCHDOG_EVERY_S <= seconds(service.get("WatchdogSec")) <= 5.0
    assert service.get("Restart") == "on-failure"
    assert 0.0 < seconds(service.get("RestartSec")) <= 1.0


def test_the_service_manager_does_not_restart_what_no_restart_helps(service: configparser.SectionProxy) -> None:
    statuses = {int(status) for status in service.get("RestartPreventExitStatus", "").split()}
    assert statuses == {ExitCode.CONFIG, ExitCode.UNAVAILABLE}


def test_the_service_manager_waits_longer_for_the_end_than_the_daemon_for_its_table(
    service: configparser.SectionProxy,
) -> None:
    assert seconds(service.get("TimeoutStopSec")) > session.CLOSE_TIMEOUT_S
