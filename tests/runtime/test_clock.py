"""Kinds of time: the machine's, and the plant's in lockstep, whatever order the bus delivers its frames in."""

from __future__ import annotations

import time
from dataclasses import replace
from itertools import permutations
from typing import TYPE_CHECKING

from virtual_shell import VirtualShell

from positioner.runtime.clock import RealClock
from positioner.runtime.lockstep import LockstepClock, LockstepGate
from positioner.runtime.session import RunOptions
from positioner.wire.codec import make_codec
from positioner.wire.messages import CanFrame, CurrentCommand, Mode, Setpoint, StemPosition
from positioner.wire.settings import WireSettings

if TYPE_CHECKING:
    from pathlib import Path

    import pytest

CODEC = make_codec()
PERIOD_S = 1e-4
PERIOD_NS = 100_000


def position(counter: int) -> CanFrame:
    return CODEC.encode(StemPosition(0.08), counter)


def setpoint(counter: int) -> CanFrame:
    return CODEC.encode(Setpoint(0.08), counter)


def test_the_real_clock_is_the_monotonic_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(time, "monotonic_ns", lambda: 123_456)
    monkeypatch.setattr(time, "time_ns", lambda: 456)
    assert RealClock().now_ns(()) == 123_000  # whole microseconds, as a log holds them


def test_each_position_frame_makes_one_period_pass() -> None:
    clock = LockstepClock(CODEC, PERIOD_S)
    assert clock.now_ns(()) == 0
    stamps = [clock.now_ns((position(counter),)) for counter in range(600)]
    assert stamps == [PERIOD_NS * (counter + 1) for counter in range(600)]


def test_lost_frames_make_their_periods_pass() -> None:
    clock = LockstepClock(CODEC, PERIOD_S)
    clock.now_ns((position(250),))
    assert clock.now_ns((position(253), position(2))) == PERIOD_NS * (1 + 3 + 5)


def test_nothing_else_makes_time_pass() -> None:
    clock = LockstepClock(CODEC, PERIOD_S)
    clock.now_ns((position(7),))
    damaged = replace(position(8), data=bytes(8))
    other = (setpoint(9), CODEC.encode(CurrentCommand(12.0), 3), replace(position(8), is_extended=True), damaged)
    assert clock.now_ns(other) == PERIOD_NS
    assert clock.now_ns((position(7),)) == PERIOD_NS
    assert clock.now_ns((position(8),)) == 2 * PERIOD_NS


def test_the_clock_follows_the_offset_of_the_valves_identifiers() -> None:
    other = make_codec(WireSettings(id_offset=0x80))
    clock = LockstepClock(other, PERIOD_S)
    assert clock.now_ns((position(1),)) == 0
    assert clock.now_ns((other.encode(StemPosition(0.08), 1),)) == PERIOD_NS


def test_a_gate_without_a_period_passes_everything() -> None:
    frames = (position(0), setpoint(0))
    assert LockstepGate(CODEC, 0).admit(frames) == frames


def passed(gate: LockstepGate, *batches: tuple[CanFrame, ...]) -> list[tuple[CanFrame, ...]]:
    return [gate.admit(batch) for batch in batches]


def test_a_setpoint_goes_before_the_reading_it_belongs_to_in_whatever_order_they_come() -> None:
    # setpoint 0 belongs to sample 0, setpoint 1 to sample 2
    frames = (setpoint(0), position(0))
    for order in permutations(frames):
        assert passed(LockstepGate(CODEC, 2), order) == [frames]
    late = passed(
        LockstepGate(CODEC, 2), (position(0),), (setpoint(0),), (position(1),), (position(2),), (setpoint(1),)
    )
    assert late == [(), (setpoint(0), position(0)), (position(1),), (), (setpoint(1), position(2))]


def test_a_setpoint_sent_ahead_waits_for_its_sample() -> None:
    gate = LockstepGate(CODEC, 2)
    ahead = passed(gate, (setpoint(0), setpoint(1), position(0)), (position(1),), (position(2),))
    assert ahead == [(setpoint(0), position(0)), (position(1),), (setpoint(1), position(2))]


def test_frames_of_others_pass_with_the_next_reading() -> None:
    command = CODEC.encode(CurrentCommand(12.0), 0)
    assert LockstepGate(CODEC, 2).admit((command,)) == (command,)
    assert passed(LockstepGate(CODEC, 2), (position(0), command), (setpoint(0),)) == [
        (),
        (setpoint(0), position(0), command),
    ]


def test_in_real_time_no_reading_waits_for_a_setpoint(tmp_path: Path) -> None:
    options = RunOptions(setpoint_every=5)  # the virtual host sends half as many
    with VirtualShell(tmp_path, options=options, guard={"auto_arm": True}) as shell:
        shell.cycle_for(1.0)
        answered = [sent for sent in shell.world.sent if isinstance(sent.message, CurrentCommand)]
        assert len(answered) >= 90
        assert shell.mode() is Mode.ACTIVE
