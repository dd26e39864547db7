"""The daemon, cycle by cycle, on a bus and under a clock of the test: arming, silence, loss of data, bad frames."""

from __future__ import annotations

import socket
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import can
import pytest
from daemon_helpers import HERE_M, PERIOD_S, Loop
from service_manager import notifications

from positioner.bus import opening as bus_open
from positioner.bus import port as bus_module
from positioner.bus.address import BusAddress
from positioner.machine import journal
from positioner.runtime.session import RunOptions
from positioner.wire import e2e
from positioner.wire.codec import own_database
from positioner.wire.messages import (
    CanFrame,
    Cause,
    CurrentCommand,
    Health,
    HostRequest,
    Message,
    Mode,
    PositionerStatus,
    StemPosition,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

pytestmark = pytest.mark.bus
AUTO = {"auto_arm": True}
LONG_TIMEOUTS = {"feedback_hold_periods": 999, "feedback_failsafe_periods": 9999}
"""Timeouts that no test reaches by frames that it does not send."""


@pytest.fixture
def loop(tmp_path: Path) -> Iterator[Loop]:
    """A daemon that waits to be armed."""
    with Loop(tmp_path) as made:
        yield made


@pytest.fixture
def armed(tmp_path: Path) -> Iterator[Loop]:
    """A daemon that controls."""
    with Loop(tmp_path, guard={**AUTO, "setpoint_hold_s": 0.1, "setpoint_failsafe_s": 0.3}) as made:
        made.sample()
        yield made


def commands(messages: list[Message]) -> list[CurrentCommand]:
    return [message for message in messages if isinstance(message, CurrentCommand)]


def statuses(messages: list[Message]) -> list[PositionerStatus]:
    return [message for message in messages if isinstance(message, PositionerStatus)]


def own_frame(name: str, data_id: int, **signals: float) -> CanFrame:
    """Return an intact frame with raw signal values that no message of ours would have."""
    dbc = own_database().get_message_by_name(name)
    raw = {signal.name: 0 for signal in dbc.signals} | signals
    return CanFrame(dbc.frame_id, e2e.protect(dbc.encode(raw, scaling=False, strict=False), data_id))


def test_before_it_is_armed_it_sends_no_command_and_its_status_only(loop: Loop) -> None:
    sent = [message for _ in range(60) for message in loop.sample()]
    assert {type(message) for message in sent} == {PositionerStatus}
    assert {(status.mode, status.armed) for status in statuses(sent)} == {(Mode.READY, False)}
    assert loop.logged("mode INIT") == ["mode INIT -> READY (waiting for arm)"]


def test_a_request_to_arm_is_answered_with_a_command_and_a_status_at_once(loop: Loop) -> None:
    loop.sample()
    command, status = loop.request(HostRequest.ARM)
    assert isinstance(command, CurrentCommand)
    assert isinstance(status, PositionerStatus)
    assert command.mode is Mode.ACTIVE
    assert (status.mode, status.cause, status.armed, status.health) == (Mode.ACTIVE, Cause.NONE, True, Health.GOOD)


def test_a_request_to_disarm_ends_all_commands_and_keeps_the_status(armed: Loop) -> None:
    assert commands(armed.sample())
    assert commands(armed.request(HostRequest.DISARM)) == []
    sent = [message for _ in range(10) for message in armed.sample()]
    assert commands(sent) == []
    assert {(status.mode, status.cause) for status in statuses(sent)} == {(Mode.READY, Cause.DISARMED)}


def test_it_arms_itself_at_the_first_reading_where_it_may(tmp_path: Path) -> None:
    with Loop(tmp_path, guard=AUTO) as loop:
        assert commands(loop.sample())[0].mode is Mode.ACTIVE
        assert loop.logged("mode INIT") == ["mode INIT -> ACTIVE (none)"]


def test_each_command_answers_its_reading_and_names_the_setpoint_it_obeys(armed: Loop) -> None:
    armed.others.received.clear()
    for _ in range(20):
        armed.sample()
    pairs = [(m.position_counter, m.setpoint_counter) for m in (armed.others.codec.decode(f)[0] for f in
             armed.others.received) if isinstance(m, CurrentCommand)]  # fmt: skip
    assert pairs == [(number, number) for number in range(1, 21)]


def test_the_status_comes_ten_times_a_second(armed: Loop) -> None:
    sent = [message for _ in range(100) for message in armed.sample()]  # two seconds
    assert len(commands(sent)) == 100
    assert 19 <= len(statuses(sent)) <= 21


@pytest.mark.parametrize(("action", "current_ma"), [("4 mA", 4.0), ("20 mA", 20.0), ("hold", None), ("current", 7.25)])
def test_without_feedback_it_holds_and_then_fails_safe_as_configured(
    action: str, current_ma: float | None, tmp_path: Path
) -> None:
    guard = {**AUTO, "failsafe_action": action, "failsafe_current_ma": 7.25}
    with Loop(tmp_path, guard=guard) as loop:
        (last,) = commands(loop.sample())
        modes = [[command.mode for command in commands(loop.cycle())] for _ in range(11)]
        # until the third period there is no command; in HOLD and FAILSAFE there is one in each period
        assert modes == [[]] * 3 + [[Mode.HOLD]] * 7 + [[Mode.FAILSAFE]]
        (failed,) = commands(loop.cycle())
        assert failed.current_ma == (pytest.approx(current_ma) if current_ma else last.current_ma)
        assert loop.logged("FAILSAFE") == ["mode HOLD -> FAILSAFE (feedback stale)"]


def test_in_hold_the_last_current_is_repeated(armed: Loop) -> None:
    (last,) = commands(armed.sample())
    held = [command for _ in range(10) for command in commands(armed.cycle())]
    assert {command.current_ma for command in held} == {last.current_ma}
    assert {command.mode for command in held} == {Mode.HOLD}
    assert armed.logged("HOLD") == ["mode ACTIVE -> HOLD (feedback stale)"]


def test_feedback_ends_hold(armed: Loop) -> None:
    for _ in range(5):
        armed.cycle()
    assert commands(armed.sample())[0].mode is Mode.ACTIVE


def test_failsafe_stays_until_it_is_armed_again(armed: Loop) -> None:
    for _ in range(12):
        armed.cycle()
    sent = [message for _ in range(10) for message in armed.sample()]
    assert {command.mode for command in commands(sent)} == {Mode.FAILSAFE}
    assert {command.current_ma for command in commands(sent)} == {4.0}
    assert {(status.mode, status.cause, status.health) for status in statuses(sent)} == {
        (Mode.FAILSAFE, Cause.FEEDBACK_STALE, Health.FAILURE)
    }
    assert commands(armed.request(HostRequest.ARM))[0].mode is Mode.ACTIVE


def test_without_setpoints_it_holds_the_last_one_and_then_fails_safe(armed: Loop) -> None:
    armed.sample()
    modes = [commands(armed.sample(setpoint_m=None))[0].mode for _ in range(17)]
    assert modes == [Mode.ACTIVE] * 5 + [Mode.HOLD] * 10 + [Mode.FAILSAFE] * 2
    assert armed.logged("HOLD") == ["mode ACTIVE -> HOLD (setpoint stale)", "mode HOLD -> FAILSAFE (setpoint stale)"]


def test_a_setpoint_outside_the_travel_is_reported_and_the_last_one_stays(armed: Loop) -> None:
    armed.sample()
    (command,) = commands(armed.sample(setpoint_m=0.15))
    assert command.setpoint_counter == 1
    assert armed.session.state.control.setpoint_m == pytest.approx(HERE_M)
    (line,) = armed.logged("setpoint")
    assert line.startswith("setpoint 150.000 mm refused: outside the travel of 0 to 139.7 mm; the last one stays")


def test_every_kind_of_bad_frame_gets_a_line_that_names_it_and_the_loop_goes_on(tmp_path: Path) -> None:
    with Loop(tmp_path, guard={**AUTO, **LONG_TIMEOUTS}) as loop:
        loop.sample()
        position = loop.others.codec.by_kind[StemPosition]
        assert position.data_id is not None
        good = loop.others.codec.encode(StemPosition(HERE_M), 1)
        beyond = own_frame("STEM_POSITION", position.data_id, Position_mm=2**27 - 1, Counter=1)
        undefined = own_frame("STEM_POSITION", position.data_id, Quality=9, Counter=1)
        bad = {
            "wrong length: STEM_POSITION has 7 bytes instead of 8": replace(good, data=good.data[:7]),
            "wrong CRC: STEM_POSITION data": replace(good, data=good.data[:7] + bytes([good.data[7] ^ 0x40])),
            "value out of range: STEM_POSITION.Position_mm: position_m = 1.34218": beyond,
            "undefined value: STEM_POSITION.Quality: quality = 9": undefined,
            "repeated counter: StemPosition counter 0 after 0": loop.others.codec.encode(StemPosition(HERE_M), 0),
            "counter out of order: StemPosition counter 200 after 0": loop.others.codec.encode(StemPosition(0.1), 200),
        }
        for expected, frame in bad.items():
            assert commands(loop.cycle(frame)) == [], expected
            assert [line for line in loop.lines if line.startswith(f"frame refused: {expected}")], (
                expected,
                loop.lines,
            )
        send_raw(loop, is_remote_frame=True, arbitration_id=good.arbitration_id)
        send_raw(loop, is_error_frame=True, arbitration_id=good.arbitration_id, data=bytes(8))
        assert loop.logged("remote frame: STEM_POSITION")
        assert loop.logged("error frame: id 110")
        assert len(loop.logged("frame refused")) == len(bad) + 2
        assert commands(loop.sample()) == []  # after a frame out of order a reading waits for the second one in order
        (command,) = commands(loop.sample())
        assert command.mode is Mode.ACTIVE
        refused = [status.rejected_count for _ in range(6) for status in statuses(loop.sample())]
        assert set(refused) == {len(bad) + 2}


def send_raw(loop: Loop, **fields: Any) -> None:
    """Send what the port itself never sends, and let the daemon take it."""
    bus = loop.others.port._bus
    assert bus is not None
    bus.send(can.Message(is_extended_id=False, **fields))
    assert commands(loop.cycle()) == []


def test_frames_that_the_dbc_does_not_name_are_ignored(armed: Loop) -> None:
    before = list(armed.lines)
    for stranger in (CanFrame(0x7FF, b"hello"), CanFrame(0x110, bytes(8), is_extended=True), CanFrame(0x190, bytes(8))):
        armed.cycle(stranger, after_s=0.0)
    assert commands(armed.sample())
    assert armed.lines == before


def test_a_thousand_bad_frames_are_one_line_and_the_next_second_counts_them(
    armed: Loop, monkeypatch: pytest.MonkeyPatch
) -> None:
    now_s = [1e6]
    time = SimpleNamespace(monotonic_s=lambda: now_s[0])
    monkeypatch.setattr(armed.session.announcer, "throttle", journal.Throttle(time=time))
    good = armed.others.codec.encode(StemPosition(HERE_M), 1)
    crc = int.from_bytes(good.data[:2], "little")
    for number in range(1, 1001):
        damaged = (crc ^ number).to_bytes(2, "little") + good.data[2:]
        armed.cycle(replace(good, data=damaged), after_s=0.0)
    (line,) = armed.logged("wrong CRC")
    assert "more like it" not in line
    now_s[0] += 1.0
    armed.cycle(replace(good, data=bytes(8)), after_s=0.0)
    assert armed.logged("wrong CRC")[1].endswith("(999 more like it since the last line)")
    assert commands(armed.sample())[0].mode is Mode.ACTIVE


def test_lost_frames_and_implausible_readings_are_reported(armed: Loop) -> None:
    for _ in range(3):
        armed.others.frame(StemPosition(HERE_M))  # made, and lost on the way
    assert commands(armed.sample())
    assert armed.logged("lost") == ["3 frame(s) of StemPosition lost on the bus"]
    assert commands(armed.sample(position_m=0.3)) == []
    assert armed.logged("position 300.000 mm refused: outside the travel")
    assert commands(armed.sample(position_m=HERE_M + 0.055)) == []
    assert commands(armed.sample())[0].mode is Mode.ACTIVE


def test_another_controller_after_arming_is_reported_and_shown_and_the_loop_goes_on(armed: Loop) -> None:
    while armed.elapsed_ns <= 2.1e9:  # later than a second after the arming
        armed.sample()
    armed.cycle(armed.others.frame(CurrentCommand(9.5)), after_s=0.0)
    sent = [message for _ in range(6) for message in armed.sample()]
    assert len(commands(sent)) == 6
    assert {(status.cause, status.health) for status in statuses(sent)} == {(Cause.FOREIGN_COMMAND, Health.FAILURE)}
    assert len(armed.logged("another controller")) == 1


def test_a_bus_that_is_not_there_is_reported_once_and_joined_when_it_comes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real, tries = bus_open.open_bus, []

    def opened(address: BusAddress, filters: Any) -> can.BusABC:
        tries.append(address)
        if len(tries) in range(2, 6):  # the first try is that of the other nodes
            raise OSError(19, "No such device")
        return real(address, filters)

    monkeypatch.setattr(bus_module, "open_bus", opened)
    monkeypatch.setattr(bus_module, "_REOPEN_EVERY_S", 0.0)
    with Loop(tmp_path, guard=AUTO, bus=BusAddress(interface="virtual", channel=str(tmp_path))) as loop:
        for _ in range(3):
            assert loop.sample() == []
        assert len(loop.logged("cannot be opened")) == 1
        assert "No such device" in loop.logged("cannot be opened")[0]
        loop.cycle()
        assert len(tries) == 6
        assert loop.logged("is there again")
        assert commands(loop.sample())[0].mode is Mode.ACTIVE


class Cable:
    """A bus whose cable can be pulled."""

    def __init__(self, bus: can.BusABC) -> None:
        self.bus = bus
        self.pulled = False

    def recv(self, timeout: float | None) -> can.Message | None:
        if self.pulled:
            raise can.CanOperationError("Network is down", 100)
        return self.bus.recv(timeout)

    def send(self, message: can.Message, timeout: float | None = None) -> None:
        if self.pulled:
            raise can.CanOperationError("Network is down", 100)
        self.bus.send(message, timeout)

    def shutdown(self) -> None:
        self.bus.shutdown()


def test_a_bus_that_goes_and_comes_back_costs_a_failsafe_and_two_lines(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = bus_open.open_bus
    cables: list[Cable] = []

    def opened(address: BusAddress, filters: Any) -> Any:
        if cables and cables[-1].pulled:
            raise OSError(19, "No such device")
        cables.append(Cable(real(address, filters)))
        return cables[-1]

    monkeypatch.setattr(bus_module, "open_bus", opened)
    monkeypatch.setattr(bus_module, "_REOPEN_EVERY_S", 0.0)
    with Loop(tmp_path, guard=AUTO, bus=BusAddress(interface="virtual", channel=str(tmp_path))) as loop:
        assert commands(loop.sample())
        cables[-1].pulled = True
        for _ in range(12):
            loop.elapsed_ns += round(PERIOD_S * 1e9)
            loop.daemon._cycle()
        assert loop.logged("is down: Network is down")
        assert loop.logged("FAILSAFE")
        cables[-1].pulled = False
        loop.cycle()
        assert loop.logged("is there again")
        assert len(loop.logged("bus virtual")) <= 3
        assert commands(loop.sample())[0].mode is Mode.FAILSAFE
        assert commands(loop.request(HostRequest.ARM))[0].mode is Mode.ACTIVE


@pytest.mark.parametrize("dry_run", [True, False])
def test_a_dry_run_never_transmits_and_never_learns(dry_run: bool, tmp_path: Path) -> None:
    law = {"law": "paper"}
    with Loop(tmp_path, RunOptions(dry_run=dry_run), guard=AUTO, control=law) as loop:
        sent: list[Message] = []
        for number in range(120):  # rest, a slide of 12 mm, rest: a stick and a slip to learn from
            position_m = HERE_M + 0.006 * min(max(number - 40, 0), 2)
            sent += loop.sample(position_m, setpoint_m=HERE_M + (0.012 if number >= 38 else 0.0))
        table = loop.session.state.table
        if dry_run:
            assert (sent, table.sequence) == ([], 0)
        else:
            assert len(commands(sent)) == 120
            assert table.sequence >= 1
    assert loop.logged("mode INIT") == ["mode INIT -> ACTIVE (none)"]


def test_the_service_manager_is_notified_of_readiness_life_and_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        manager.setblocking(False)
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        with Loop(tmp_path) as loop:
            loop.cycle()
            received = notifications(manager)
            assert f"STATUS=waiting for position frames on {loop.address}" in received
            # the watchdog is fed from the first cycle on, and the time for the start never ends while cycles complete
            assert {line for line in received if "WATCHDOG=1" in line} == {"EXTEND_TIMEOUT_USEC=5000000\nWATCHDOG=1"}
            loop.sample()
            assert "READY=1\nSTATUS=READY: waiting for arm" in notifications(manager)
            for _ in range(3):
                loop.cycle()
            # a positioner that waits does not hang: it must not be restarted
            assert set(notifications(manager)) == {"WATCHDOG=1"}
        assert notifications(manager) == ["STOPPING=1"]


def test_a_trace_on_a_full_disk_ends_with_a_line_and_the_loop_goes_on(tmp_path: Path) -> None:
    with Loop(tmp_path, RunOptions(trace=tmp_path / "trace.csv"), guard=AUTO) as loop:
        loop.sample()
        trace = loop.session._trace._file
        trace.close()
        trace._file = Path("/dev/full").open("w", buffering=1, encoding="utf-8")  # noqa: SIM115 - the daemon closes it
        assert commands(loop.sample())
        assert loop.logged("trace") == ["the trace ends here: No space left on device"]
        assert commands(loop.sample())
    assert len(loop.logged("trace")) == 1
