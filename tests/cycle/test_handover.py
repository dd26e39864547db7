"""Manual mode in the whole cycle: the current as given, nothing learned, and no bump on the way back."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from test_cycle import CODEC, MS, RESTING, SLIDING, WIDE, Exchange, ScriptedLaw, commands

from plant_emulator.device import advance, initial_device, publish, take
from plant_emulator.presets import plant_settings
from positioner.cli.main import main
from positioner.config.reader import parse_config
from positioner.cycle.events import Learned
from positioner.cycle.handover import Handover, blend, start_m, update_handover
from positioner.cycle.input import CycleInput
from positioner.cycle.state import CycleState, Setup
from positioner.cycle.step import step
from positioner.guard.settings import GuardSettings
from positioner.laws.law import Decision
from positioner.runtime.record import BusRecorder
from positioner.wire.messages import (
    CanFrame,
    Cause,
    CurrentCommand,
    Health,
    ManualCurrent,
    ManualRequest,
    Mode,
    Motion,
    PositionerStatus,
    Setpoint,
    StemPosition,
)

if TYPE_CHECKING:
    from positioner.laws.law import Observation
    from positioner.valve.state import StemState
    from positioner.valve.stiction import StictionTable


class RestingLaw(ScriptedLaw):
    """The scripted law for a stem that it keeps where it is."""

    def decide(
        self, memory: int, stem: StemState, observation: Observation, table: StictionTable
    ) -> tuple[int, Decision]:
        memory, decision = super().decide(memory, stem, observation, table)
        return memory, replace(decision, motion=Motion.REST)


class ByHand(Exchange):
    """A scripted exchange whose host can also give the current."""

    manuals = 0

    def order(self, current_ma: float, request: ManualRequest = ManualRequest.MANUAL) -> CanFrame:
        self.manuals += 1
        return CODEC.encode(ManualCurrent(current_ma, request), self.manuals)

    def sample_by_hand(self, current_ma: float, position_m: float) -> None:
        self.step(CODEC.encode(StemPosition(position_m), self.counter), self.order(current_ma))
        self.counter += 1

    def cycle(self, *frames: CanFrame, position_m: float = 0.08) -> CurrentCommand:
        reading = CODEC.encode(StemPosition(position_m), self.counter)
        self.counter += 1
        ((command, _),) = commands(self.step(reading, *frames))
        return command


def test_the_current_is_the_one_that_was_given_and_the_last_one_until_then() -> None:
    it = ByHand()
    assert it.cycle().current_ma == 10.0
    command = it.cycle(it.order(9.5))
    assert (command.mode, command.motion, command.current_ma) == (Mode.MANUAL, Motion.NONE, 9.5)
    assert it.cycle().current_ma == 9.5
    assert it.cycle(it.order(11.25)).current_ma == 11.25


@pytest.mark.parametrize(("wanted_ma", "given_ma"), [(0.0, 6.0), (5.999, 6.0), (18.0, 18.0), (25.0, 18.0)])
def test_a_current_by_hand_keeps_the_limits(wanted_ma: float, given_ma: float) -> None:
    it = ByHand(guard=GuardSettings(auto_arm=True, current_low_ma=6.0, current_high_ma=18.0))
    it.cycle()
    assert it.cycle(it.order(wanted_ma)).current_ma == given_ma


def test_a_current_by_hand_keeps_the_rate() -> None:
    it = ByHand(guard=GuardSettings(auto_arm=True, max_rate_ma_per_s=100.0))
    first_ma = it.cycle().current_ma
    wanted_ma = first_ma - 2.0
    currents = [it.cycle(it.order(wanted_ma)).current_ma for _ in range(25)]
    assert currents[:3] == pytest.approx([first_ma - 0.1, first_ma - 0.2, first_ma - 0.3], abs=1e-9)
    assert currents[19:] == pytest.approx([wanted_ma] * 6, abs=1e-9)


def test_without_feedback_a_new_current_by_hand_is_still_sent() -> None:
    it = ByHand()
    it.cycle(it.order(9.5))
    it.step(elapsed_ns=100 * MS)
    (command, _), *_ = commands(it.step(it.order(8.5), elapsed_ns=10 * MS))
    assert (command.mode, command.current_ma) == (Mode.MANUAL, 8.5)


def test_a_frozen_sensor_is_reported_in_manual_mode_and_does_not_end_it() -> None:
    it = ByHand()
    it.sample()
    for number in range(2200):
        it.sample_by_hand(20.0, 0.08)
        assert (it.state.guard.cause is Cause.FEEDBACK_FROZEN) is (number > 2010), number
    assert it.state.guard.mode is Mode.MANUAL


def test_nothing_is_learned_in_manual_mode_and_the_law_starts_again_after_it() -> None:
    law = ScriptedLaw(stems=[RESTING, *[SLIDING, RESTING] * 20])
    it = ByHand(law)
    it.cycle()
    it.cycle()
    taught = len(it.events_of(Learned))
    assert taught > 0
    for _ in range(10):
        it.cycle(it.order(9.5))
        assert it.state.control.memory is None
        assert it.state.control.stem is None
    assert len(it.events_of(Learned)) == taught
    assert len(law.shown) == 2
    it.cycle(it.order(9.5, ManualRequest.AUTO))
    assert len(law.begun_m) == 2
    assert len(it.events_of(Learned)) == taught


def test_the_status_reports_function_check_in_manual_mode() -> None:
    it = ByHand()
    it.cycle()
    statuses: list[PositionerStatus] = []
    for _ in range(150):
        frames = it.step(CODEC.encode(StemPosition(0.08), it.counter), it.order(9.5))
        it.counter += 1
        decoded = [CODEC.decode(frame)[0] for frame in frames]
        statuses += [message for message in decoded if isinstance(message, PositionerStatus)]
    last = statuses[-1]
    assert (last.mode, last.health, last.armed) == (Mode.MANUAL, Health.FUNCTION_CHECK, True)


def test_back_in_automatic_mode_the_position_is_held_until_the_setpoint_changes() -> None:
    it = ByHand()
    old, new = Setpoint(0.06), Setpoint(0.0600001)
    it.sample(setpoint=old)
    it.sample(setpoint=old)
    assert it.law.shown[-1].setpoint_m == pytest.approx(0.06)
    it.cycle(it.order(12.0), position_m=0.09)
    for number in range(200):
        it.cycle(it.order(12.0), position_m=0.0901 if number % 2 else 0.0899)
    it.cycle(it.order(12.0, ManualRequest.AUTO), position_m=0.095)
    assert it.law.begun_m[-1] == pytest.approx(0.09, abs=1e-5)
    assert it.law.shown[-1].setpoint_m == pytest.approx(0.09, abs=1e-5)
    for _ in range(50):
        it.sample(0.095, setpoint=old)
        assert it.law.shown[-1].setpoint_m == pytest.approx(0.09, abs=1e-5)
    it.sample(0.095, setpoint=new)
    assert it.law.shown[-1].setpoint_m == pytest.approx(0.0600001, abs=1e-8)
    it.sample(0.095, setpoint=old)
    assert it.law.shown[-1].setpoint_m == pytest.approx(0.06)


def test_after_a_failsafe_or_a_disarm_the_hosts_setpoint_counts_again() -> None:
    for mode in (Mode.FAILSAFE, Mode.READY, Mode.INIT):
        held = update_handover(Handover(0.08, 5), Mode.ACTIVE, 0.08, 0.06, 9.5)
        assert held is not None
        assert update_handover(held, mode, 0.08, 0.06, 9.5) is None


def test_the_mean_is_of_up_to_a_hundred_readings_under_one_current() -> None:
    handover: Handover | None = None
    for measured_m in (0.07, 0.08, 0.09):
        handover = update_handover(handover, Mode.MANUAL, measured_m, None, 9.5)
    assert start_m(handover, 0.5) == pytest.approx(0.08, rel=1e-12)
    handover = update_handover(handover, Mode.MANUAL, None, None, 9.5)
    assert start_m(handover, 0.5) == pytest.approx(0.08, rel=1e-12)
    handover = update_handover(handover, Mode.MANUAL, None, None, 9.6)
    assert start_m(handover, 0.5) == 0.5
    for _ in range(100):
        handover = update_handover(handover, Mode.MANUAL, 0.1, None, 9.6)
    handover = update_handover(handover, Mode.MANUAL, 0.2, None, 9.6)
    assert start_m(handover, 0.5) == pytest.approx(0.101, rel=1e-9)
    assert start_m(None, 0.5) == 0.5


def test_the_laws_first_current_is_the_one_by_hand_and_the_difference_fades_within_a_second() -> None:
    it = ByHand(RestingLaw())
    it.cycle()
    it.cycle(it.order(7.0))
    currents = [it.cycle(it.order(7.0, ManualRequest.AUTO)).current_ma]
    currents += [it.cycle().current_ma for _ in range(1100)]
    wanted = [10.0 + 0.001 * number for number in range(1101)]
    assert currents[0] == 7.0
    assert currents[500] == pytest.approx(wanted[500] - 1.5, abs=2e-3)
    assert currents[1001:] == pytest.approx(wanted[1001:], abs=1e-9)
    assert max(np.abs(np.diff(currents))) < 0.0055


def test_the_blend_ends_after_a_second_and_copies_nothing_from_then_on() -> None:
    still, handover = Decision(10.0, WIDE), Handover(0.08, 5, begun=True, offset_ma=-3.0)
    assert blend(handover, still, 7.0, 1000 * MS - 1)[1].current_ma == pytest.approx(10.0, abs=1e-8)
    assert blend(handover, still, 7.0, 500 * MS)[1].current_ma == 8.5
    assert blend(handover, still, 7.0, 1000 * MS)[1] is still


def test_a_manual_current_without_a_reading_starts_an_empty_mean() -> None:
    assert update_handover(None, Mode.MANUAL, None, None, 12.0) == Handover(current_ma=12.0)


def test_a_move_or_a_new_setpoint_gets_the_very_current_that_the_law_asks_for() -> None:
    still, move = Decision(10.0, WIDE), Decision(12.0, WIDE, Motion.MOVE)
    handover, blended = blend(Handover(0.08, 5, begun=True), still, 7.0, 0)
    assert blended.current_ma == 7.0
    handover, blended = blend(handover, move, 7.0, MS)
    assert blended is move
    handover, blended = blend(handover, still, 12.0, 2 * MS)
    assert blended is still
    it = ByHand(RestingLaw())
    it.sample(setpoint=Setpoint(0.06))
    it.cycle(it.order(7.0))
    it.cycle(it.order(7.0, ManualRequest.AUTO))
    ((command, _),) = commands(it.sample(setpoint=Setpoint(0.07)))
    assert command.current_ma == pytest.approx(10.001)


class Loop:
    """The law of a configuration and the emulated valve, in virtual time at 1 kHz."""

    def __init__(self, law: str, record: Path | None = None) -> None:
        self.text = f'[valve]\nid = "V"\npreset = "paper"\n[control]\nlaw = "{law}"\n[guard]\nauto_arm = true\n'
        configuration = parse_config(self.text, "test", Path())
        self.codec = configuration.make_codec()
        self.setup = Setup(self.codec, configuration.valve, configuration.guard, configuration.make_law(), 0.001)
        self.recorder = BusRecorder(record)
        self.plant = plant_settings("paper")
        self.device = initial_device(self.plant, 3)
        self.state = CycleState()
        self.now_ns = 0
        self.setpoints = self.manuals = 0

    def run(self, periods: int, setpoint_m: float | None = None, manual: ManualCurrent | None = None) -> list[float]:
        """Return the currents of so many periods; the frames of the host are sent in every tenth of them."""
        currents: list[float] = []
        for number in range(periods):
            self.device, frames = publish(self.codec, self.plant, self.device)
            if setpoint_m is not None and number % 10 == 0:
                self.setpoints += 1
                frames = (*frames, self.codec.encode(Setpoint(setpoint_m), self.setpoints))
            if manual is not None and number % 10 == 0:
                self.manuals += 1
                frames = (*frames, self.codec.encode(manual, self.manuals))
            self.now_ns += MS
            cycle_input = CycleInput(tuple(frames), self.now_ns)
            self.state, outbox, _ = step(self.setup, self.state, cycle_input)
            self.recorder.cycle(cycle_input, outbox, self.state.guard)
            currents += [command.current_ma for command, _ in commands(outbox)]
            self.device = advance(self.plant, take(self.codec, self.device, tuple(outbox)), 0.001)
        return currents

    @property
    def true_m(self) -> float:
        return self.device.plant.stem.position_m


@pytest.mark.parametrize("law", ["nmpc", "paper", "pi"])
def test_the_emulated_stem_stays_where_it_is_when_automatic_mode_comes_back(law: str) -> None:
    it = Loop(law)
    it.run(1000, 0.08)
    by_hand = it.run(800, 0.08, ManualCurrent(18.5))
    assert by_hand[-1] == 18.5
    there_m = it.true_m
    assert abs(there_m - 0.08) > 0.005
    auto = ManualCurrent(18.5, ManualRequest.AUTO)
    currents = it.run(3, 0.08, auto)
    assert abs(currents[0] - 18.5) < 1e-3
    currents += it.run(1100, 0.08)
    assert abs(it.true_m - there_m) < 0.0015
    it.run(1000, 0.085)
    assert abs(it.true_m - 0.085) < 0.0015


def test_a_record_of_manual_mode_replays_to_the_bit(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, config = tmp_path / "bus.log", tmp_path / "valve.toml"
    it = Loop("nmpc", log)
    config.write_text(it.text, encoding="utf-8")
    it.run(300, 0.08)
    it.run(300, 0.08, ManualCurrent(18.5))
    it.run(20, 0.08, ManualCurrent(18.5, ManualRequest.AUTO))
    it.run(300, 0.08)
    it.recorder.close()
    assert main(["replay", str(log), "--config", str(config)]) == 0
    assert "identical" in capsys.readouterr().out
