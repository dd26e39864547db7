"""What the service manager is told about several valves: readiness, life, and who is in trouble."""

from __future__ import annotations

import socket
from typing import TYPE_CHECKING

import pytest
from service_manager import notifications
from several_loop import OTHER_BUS, SeveralLoop

from positioner.errors import UsageError
from positioner.machine.time import MachineTime
from positioner.runtime.announce import Announcer
from positioner.runtime.service import in_words

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


@pytest.fixture
def manager(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as made:
        made.bind(str(tmp_path / "notify"))
        made.setblocking(False)
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        yield made


def valve(name: str, state: str, *, in_trouble: bool = False) -> Announcer:
    announcer = Announcer(name, MachineTime())
    announcer.tell(state, in_trouble=in_trouble)
    return announcer


def test_valves_in_trouble_are_named_and_the_others_counted() -> None:
    stale, ready, active = "HOLD: feedback stale", "READY: waiting for arm", "ACTIVE"
    valves = [valve("A", active), valve("B", stale, in_trouble=True), valve("C", active), valve("D", ready)]
    assert in_words(valves) == "B HOLD: feedback stale; 2 ACTIVE; 1 READY: waiting for arm"
    assert in_words([*valves, valve("E", stale, in_trouble=True)]).startswith("B, E HOLD: feedback stale; 2 ACTIVE")
    assert in_words([valve("", "ACTIVE")]) == "ACTIVE"


def test_the_daemon_is_ready_when_the_last_valve_has_sent_its_first_reading(
    tmp_path: Path, manager: socket.socket
) -> None:
    with SeveralLoop(tmp_path / "a", ("FV-1", "FV-2", "FV-3"), ("FV-3",), lockstep=False) as loop:
        loop.plants["FV-2"].is_silent = True
        loop.run_to(5, "FV-1", "FV-3")
        told = notifications(manager)
        assert "STATUS=FV-2 waiting for position frames on virtual:one; 2 ACTIVE" in told
        assert not [line for line in told if "READY=1" in line]
        loop.plants["FV-2"].is_silent = False
        loop.run_to(10)
        assert [line for line in notifications(manager) if "READY=1" in line] == ["READY=1\nSTATUS=3 ACTIVE"]
        loop.run_to(300)
        assert set(notifications(manager)) == {"WATCHDOG=1"}
        loop.buses[OTHER_BUS].is_cut = True
        loop.run_to(340, "FV-1")
        states = [line for line in notifications(manager) if line.startswith("STATUS")]
        assert states == [
            "STATUS=FV-3 HOLD: feedback stale; 2 ACTIVE",
            "STATUS=FV-3 FAILSAFE: feedback stale; 2 ACTIVE",
        ]


def test_a_valve_whose_cycle_hangs_ends_the_sign_of_life_of_all(
    tmp_path: Path, manager: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    with SeveralLoop(tmp_path / "a", ("FV-1", "FV-2"), lockstep=False) as loop:
        loop.run_to(150)
        assert "WATCHDOG=1" in notifications(manager)
        loop.time.sleep(0.2)  # another sign is due

        def hang(*_arguments: object) -> None:
            raise KeyboardInterrupt

        monkeypatch.setattr(loop.sessions["FV-2"], "cycle", hang)
        with pytest.raises(KeyboardInterrupt):
            loop.run_to(1000)
        assert not [line for line in notifications(manager) if "WATCHDOG" in line]


def test_a_valve_that_has_ended_is_named_and_does_not_delay_readiness(tmp_path: Path, manager: socket.socket) -> None:
    with SeveralLoop(tmp_path / "a", ("FV-1", "FV-2"), lockstep=False) as loop:
        loop.plants["FV-2"].is_silent = True
        loop.run_to(5, "FV-1")
        session = loop.sessions["FV-2"]
        session.end(UsageError("no more"))
        loop.daemon._running.remove(session)
        loop.daemon._report_states()
        assert notifications(manager)[-1] == "READY=1\nSTATUS=FV-2 ended: no more; 1 ACTIVE"
