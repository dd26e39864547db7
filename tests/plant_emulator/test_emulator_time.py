"""When commands act on the emulated valve, in real time and in lockstep, on a clock and a bus of the test."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import pytest

from plant_emulator import daemon as emulator
from plant_emulator.cli.main import main
from plant_emulator.daemon import EmulatorDaemon, EmulatorOptions
from plant_emulator.presets import plant_settings
from positioner.bus.address import BusAddress
from positioner.errors import BenchError, ExitCode
from positioner.wire.codec import make_codec
from positioner.wire.messages import CanFrame, CurrentCommand, StemPosition

if TYPE_CHECKING:
    from collections.abc import Sequence

CODEC = make_codec()
PERIOD_NS = 1_000_000
NS = 1_000_000_000


@dataclass
class World:
    """A clock, and a bus on which commands come at known instants, in ns since the start.

    stall: from the first instant to the second the emulator does not run. restarted_at: which command is the first of
    another positioner.
    """

    commands: Sequence[int]
    end_ns: int
    stall: tuple[int, int] = (0, 0)
    restarted_at: int = -1
    now_ns: int = 0
    sent: list[CanFrame] = field(default_factory=list)
    _given: int = 0

    def monotonic_ns(self) -> int:
        return self.now_ns

    def monotonic(self) -> float:
        return self.now_ns / NS

    def receive(self, timeout_s: float) -> tuple[CanFrame, ...]:
        end_ns = self.now_ns + round(timeout_s * NS)
        if self._given < len(self.commands) and self.commands[self._given] <= end_ns:
            self.now_ns = max(self.now_ns, self.commands[self._given])
            counter = 0 if self._given == self.restarted_at else self._given
            frame = CODEC.encode(CurrentCommand(12.0 + 0.01 * self._given, self._given), counter)
            self._given += 1
            return (replace(frame, received_ns=self.commands[self._given - 1]),)
        self.now_ns = end_ns
        if self.stall[0] <= self.now_ns < self.stall[1]:
            self.now_ns = self.stall[1]
        return ()

    def send(self, frame: CanFrame) -> bool:
        self.sent.append(frame)
        return True


def played(world: World, monkeypatch: pytest.MonkeyPatch, delay_s: float) -> list[float]:
    """Return when each command acted, in ms of the plant's time."""
    options = EmulatorOptions(
        bus=BusAddress(), period_s=PERIOD_NS / NS, seed=1, lockstep=False, command_delay_s=delay_s
    )
    node = EmulatorDaemon(plant_settings("paper"), CODEC, options)
    acted_ms: list[float] = []
    advance = node._advance

    def watched(duration_s: float) -> None:
        if node._state.current_ma is not None:
            at_ms = round(1e3 * node._state.commanded_s, 6)
            if at_ms not in acted_ms[-1:]:
                acted_ms.append(at_ms)
        advance(duration_s)
        node._stopping = world.now_ns >= world.end_ns

    monkeypatch.setattr(emulator, "time", world)
    monkeypatch.setattr(node, "_bus", world)
    monkeypatch.setattr(node, "_advance", watched)
    node._run_real_time()
    return acted_ms


def echoes(world: World) -> list[int | None]:
    messages = [CODEC.decode(frame)[0] for frame in world.sent]
    return [message.command_counter for message in messages if isinstance(message, StemPosition)]


def test_without_a_delay_a_command_acts_when_it_arrives(monkeypatch: pytest.MonkeyPatch) -> None:
    world = World([300_000, 1_450_000, 2_700_000], 4_000_000)
    assert played(world, monkeypatch, 0.0) == [0.3, 1.45, 2.7]


def test_with_a_delay_commands_act_at_that_instant_of_a_period_and_a_late_one_a_period_later(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    world = World([300_000, 1_790_000, 2_810_000], 6_000_000)
    assert played(world, monkeypatch, 0.0008) == [0.8, 1.8, 3.8]
    assert echoes(world)[:5] == [0, 0, 1, 1, 2]


def test_of_two_commands_in_one_period_the_newer_one_acts(monkeypatch: pytest.MonkeyPatch) -> None:
    world = World([850_000, 1_100_000], 4_000_000)
    assert played(world, monkeypatch, 0.0008) == [1.8]
    assert echoes(world)[:3] == [0, 0, 1]


def test_commands_that_waited_while_the_emulator_stood_still_act_when_they_should_have(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    world = World([300_000, 2_500_000, 3_500_000], 6_000_000, stall=(1_000_000, 4_900_000))
    assert played(world, monkeypatch, 0.0008) == [0.8, 2.8, 3.8]


def test_after_a_long_stall_readings_that_are_too_late_are_lost_and_not_sent_together(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    world = World([], 24_500_000, stall=(1_000_000, 20_500_000))
    played(world, monkeypatch, 0.0)
    decoded = (CODEC.decode(frame) for frame in world.sent)
    counters = [counter for message, counter in decoded if isinstance(message, StemPosition)]
    assert counters == [0, 17, 18, 19, 20, 21, 22, 23, 24]  # 1 to 16 would be more than four periods late


def waiting(world: World, monkeypatch: pytest.MonkeyPatch, setpoint_every: int) -> list[int | None]:
    """Return the counters of the readings of an emulator in lockstep that two commands reach, and then no more."""
    options = EmulatorOptions(
        bus=BusAddress(), period_s=PERIOD_NS / NS, seed=1, lockstep=True, setpoint_every=setpoint_every
    )
    node = EmulatorDaemon(plant_settings("paper"), CODEC, options)
    receive = world.receive

    def until_its_end(timeout_s: float) -> tuple[CanFrame, ...]:
        node._stopping = world.now_ns >= world.end_ns
        return receive(timeout_s)

    monkeypatch.setattr(emulator, "time", world)
    monkeypatch.setattr(world, "receive", until_its_end)
    monkeypatch.setattr(node, "_bus", world)
    node._run_lockstep()
    decoded = (CODEC.decode(frame) for frame in world.sent)
    return [counter for message, counter in decoded if isinstance(message, StemPosition)]


def test_in_lockstep_a_reading_is_sent_again_until_a_positioner_is_there(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    world = World([5 * NS, 5 * NS + 1_000_000, 10 * NS], 100 * NS, restarted_at=2)
    counters = waiting(world, monkeypatch, 0)
    # again after 2 s and 4 s; two commands; again after two s and four s; the first command of the next positioner
    assert counters[:8] == [0, 0, 0, 1, 2, 2, 2, 3]
    assert set(counters[8:]) == {3}
    assert len(counters[8:]) == pytest.approx(90 / 2.1, abs=1)  # it looks every 0.1 s
    told = [line for line in capsys.readouterr().err.splitlines() if "waits at sample" in line]
    assert len(told) == 3


def test_in_a_bench_a_reading_that_nobody_answers_is_sent_once(monkeypatch: pytest.MonkeyPatch) -> None:
    world = World([], 100 * NS)
    with pytest.raises(BenchError, match="it waits at sample 0: no setpoint frame within 30 s"):
        waiting(world, monkeypatch, 10)
    assert world.sent == []


def test_a_delay_of_more_than_a_period_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "--period", "0.001", "--command-delay", "0.002"]) == ExitCode.USAGE
    assert "--command-delay 0.002 is longer than --period 0.001" in capsys.readouterr().err
