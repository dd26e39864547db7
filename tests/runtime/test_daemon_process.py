"""The daemon as a service: started, armed, stopped, killed, doubled, and with frames of the user's own."""

from __future__ import annotations

import contextlib
import subprocess
import time
from typing import TYPE_CHECKING, Any

import cantools
import pytest
from daemon_helpers import HERE_M, PERIOD_S, TIMEOUT_S, Service, own_address, write_configuration

from positioner.bench.processes import BenchProcess
from positioner.bus.port import BusPort
from positioner.errors import ExitCode
from positioner.store import access
from positioner.wire.messages import CanFrame, CurrentCommand, HostRequest, Mode, PositionerStatus, Setpoint

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.bus
MOST_SAMPLES_PER_CYCLE = 3
"""Samples that one cycle can learn: a stick speed, a landing and a breakaway."""
LONG_TIMEOUTS = {"feedback_hold_periods": 500, "feedback_failsafe_periods": 5000, "setpoint_hold_s": 10.0,
                 "setpoint_failsafe_s": 100.0}  # fmt: skip
"""Timeouts that a busy machine does not reach between two frames of a test."""


def test_a_service_commands_nothing_until_armed_and_saves_its_table_at_the_end(tmp_path: Path) -> None:
    with Service(tmp_path, guard=LONG_TIMEOUTS) as service:
        service.others.report()
        service.child.wait_for("READY=1")
        for _ in range(20):
            service.others.ask()
            service.others.report()
            assert not any(isinstance(message, CurrentCommand) for message in service.others.listen(PERIOD_S))
        service.arm()
        service.next(PositionerStatus)
        service.child.drain()

        second = BenchProcess("positioner.cli.main", ["run", "--config", str(service.path)], tmp_path / "second.log")
        assert ended(second, service) == ExitCode.TEMPORARY
        waiting, line = second.log.read_text(encoding="utf-8").splitlines()
        occupied = f"{tmp_path / 'state'}: in use by process {service.child.process.pid};"
        assert waiting.startswith(f"WARNING waiting 10 s at most: {occupied}")
        assert line.startswith(f"positioner: {occupied}")

        assert service.next(CurrentCommand).mode is Mode.ACTIVE
        assert service.stop() == ExitCode.OK
        assert service.lines[-1] == "INFO stopped; the stiction table is saved"
    assert access.dump(tmp_path / "state").valve_id == "FV-101"


def ended(child: BenchProcess, beside: Service, *foreign: CurrentCommand) -> int:
    """Return the exit status of a program that ends by itself; meanwhile the service goes on and `foreign` is sent."""
    deadline_s = time.monotonic() + TIMEOUT_S
    while (code := child.process.poll()) is None:
        assert time.monotonic() < deadline_s, child.log.read_text(encoding="utf-8")
        beside.others.say(*foreign)
        beside.others.ask()
        beside.others.report()
        beside.others.listen(PERIOD_S)
    child.stop()
    return code


def test_a_held_arm_does_not_arm_a_daemon_that_starts_again(tmp_path: Path) -> None:
    with Service(tmp_path) as service:
        service.arm()
        service.kill()
        service.start()
        deadline_s = time.monotonic() + TIMEOUT_S
        while not service.logged("mode INIT -> READY (waiting for arm)")[1:]:
            assert time.monotonic() < deadline_s, service.lines
            assert not any(isinstance(message, CurrentCommand) for message in service.request(HostRequest.ARM))
        for _ in range(50):
            assert not any(isinstance(message, CurrentCommand) for message in service.request(HostRequest.ARM))
        service.arm()
        assert service.stop() == ExitCode.OK


def test_another_controller_on_the_bus_ends_a_daemon_before_it_sends_a_frame(tmp_path: Path) -> None:
    with Service(tmp_path) as service:
        assert ended(service.child, service, CurrentCommand(9.5)) == ExitCode.UNAVAILABLE
        expected = "positioner: not started: another controller commands this valve (9.500 mA): stop it, or give one"
        assert [line[: len(expected)] for line in service.lines if line.startswith("positioner:")] == [expected]
        assert service.others.received == []


def test_a_service_waits_for_a_bus_that_is_not_there_and_can_be_stopped_meanwhile(tmp_path: Path) -> None:
    path = write_configuration(tmp_path, own_address())
    arguments = ["run", "--config", str(path), "--bus", "socketcan:vcan77"]
    with BenchProcess("positioner.cli.main", arguments, tmp_path / "daemon.log") as child:
        deadline_s = time.monotonic() + TIMEOUT_S
        while "cannot be opened" not in child.log.read_text(encoding="utf-8"):
            assert time.monotonic() < deadline_s
            with contextlib.suppress(subprocess.TimeoutExpired):
                child.process.wait(0.05)
        assert child.stop() == ExitCode.OK
        lines = child.log.read_text(encoding="utf-8").splitlines()
    assert len([line for line in lines if "bus socketcan:vcan77 cannot be opened" in line]) == 1
    assert any("sudo ip link add dev vcan77 type vcan" in line for line in lines)


def test_a_kill_loses_nothing_that_was_learned_and_a_reset_is_taken_over(tmp_path: Path) -> None:
    guard = {"auto_arm": True}
    control = {"sample_period_s": 0.001}
    options = ("--verbose", "--clock", "lockstep")
    with Service(tmp_path, *options, guard=guard, control=control) as service:
        with plant(service) as emulator:
            learn(service, emulator, 4)
            service.kill()
        learned = len(service.logged("learned"))
        service.start(*options)
        # samples that were handed over are there; those of the last cycle may be logged but not handed over
        assert learned - MOST_SAMPLES_PER_CYCLE <= access.dump(tmp_path / "state").table.sequence <= learned
        with plant(service) as emulator:
            learn(service, emulator, learned + 4)
            assert access.reset(tmp_path / "state") is not None
            deadline_s = time.monotonic() + TIMEOUT_S
            while not service.logged("the stiction table was replaced: reset"):
                assert time.monotonic() < deadline_s, service.lines
                service.others.listen(PERIOD_S)
            before = len(service.logged("learned"))
            learn(service, emulator, before + 2)
            assert service.stop() == ExitCode.OK
        afterwards = service.lines[service.lines.index(service.logged("replaced: reset")[0]) :]
    assert access.dump(tmp_path / "state").table.sequence == len([line for line in afterwards if "learned" in line])


def plant(service: Service) -> BenchProcess:
    """Return an emulated valve on the service's bus."""
    arguments = ["run", "--bus", str(service.address), "--clock", "lockstep", "--seed", "3"]
    child = BenchProcess("plant_emulator.cli.main", arguments, service.folder / "plant.log")
    child.wait_for("READY=1")
    return child


def learn(service: Service, emulator: BenchProcess, wanted: int) -> None:
    """Send the stem to and fro until the log has `wanted` lines about learned samples."""
    deadline_s, number = time.monotonic() + TIMEOUT_S, 0
    while len(service.logged("learned")) < wanted:
        emulator.check()
        assert time.monotonic() < deadline_s, service.lines
        service.others.ask(0.073 + 0.014 * (number // 20 % 2))
        number += 1
        service.others.listen(PERIOD_S)


USERS_DBC = """VERSION ""
NS_ :
BS_:
BU_: VALVE HOST
BO_ 2566844927 VALVE_FEEDBACK: 4 VALVE
 SG_ StemPosition : 7|16@0+ (0.01,0) [0|110] "%" HOST
 SG_ Spare : 16|16@1+ (1,0) [0|0] "" HOST
BO_ 2566844926 IP_COMMAND: 2 HOST
 SG_ LoopCurrent : 0|16@1+ (0.01,0) [0|100] "%" VALVE
"""
USERS_WIRE = {
    "dbc": "users.dbc",
    "stem_position": {"message": "VALVE_FEEDBACK", "signals": {"position_m": "StemPosition"}},
    "current_command": {"message": "IP_COMMAND", "signals": {"current_ma": "LoopCurrent"}},
}


def test_a_valve_that_speaks_frames_of_its_own_is_controlled(tmp_path: Path) -> None:
    (tmp_path / "users.dbc").write_text(USERS_DBC, encoding="utf-8")
    database = cantools.database.load_string(USERS_DBC, "dbc")
    feedback, order = database.get_message_by_name("VALVE_FEEDBACK"), database.get_message_by_name("IP_COMMAND")  # type: ignore[union-attr]
    assert feedback.is_extended_frame
    guard = {**LONG_TIMEOUTS, "auto_arm": True}
    with Service(tmp_path, wire=USERS_WIRE, guard=guard, control={"sample_period_s": 0.001}) as service:
        valve = BusPort(service.address, [(order.frame_id, True)])
        valve.open()
        try:
            reading = feedback.encode({"StemPosition": HERE_M / 0.127 * 100.0, "Spare": 0})
            currents: list[float] = []
            deadline_s = time.monotonic() + TIMEOUT_S
            while len(currents) < 40:
                assert time.monotonic() < deadline_s, service.lines
                if len(currents) == 20:
                    service.others.say(Setpoint(0.09))  # ours still: only two messages are the user's
                assert valve.send(CanFrame(feedback.frame_id, reading, is_extended=True))
                received: list[Any] = [order.decode(frame.data) for frame in valve.receive(PERIOD_S)]
                currents += [4.0 + 0.16 * signals["LoopCurrent"] for signals in received]
        finally:
            valve.close()
        assert service.logged("mode INIT") == ["INFO mode INIT -> ACTIVE (none)"]
        assert service.logged("refused") == []
        assert service.stop() == ExitCode.OK
    balance_ma = 52538.0 * HERE_M / (0.06452 * 5171.06775)
    friction_ma = 1707.7 / (0.06452 * 5171.06775)
    assert balance_ma - friction_ma < currents[15] < balance_ma + friction_ma
    assert abs(currents[-1] - currents[15]) > 0.5, currents
