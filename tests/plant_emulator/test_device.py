"""The emulated node: it accepts valid commands only, reports with counters, and goes to its fail position by itself."""

from __future__ import annotations

import math
import statistics
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from plant_emulator import valve
from plant_emulator.daemon import EmulatorDaemon, EmulatorOptions
from plant_emulator.device import DeviceState, advance, failure, initial_device, publish, take
from plant_emulator.parameters import FailPosition, PlantSettings
from plant_emulator.presets import plant_settings
from plant_emulator.stem import Stem
from positioner.bus.address import BusAddress
from positioner.wire.codec import make_codec
from positioner.wire.file import wire_codec
from positioner.wire.messages import (
    ActuatorState,
    CanFrame,
    CurrentCommand,
    Message,
    PlantTruth,
    Quality,
    Setpoint,
    StemPosition,
)
from positioner.wire.settings import MessageSettings, WireSettings

if TYPE_CHECKING:
    from collections.abc import Sequence

PERCENT = Path(__file__).parents[2] / "examples" / "percent.toml"
CODEC = make_codec()
PAPER = plant_settings("paper")
PERIOD_S = 0.001
BALANCE_MA = PAPER.valve.spring_rate_n_per_m * PAPER.valve.initial_position_m / (
    PAPER.valve.diaphragm_area_m2 * PAPER.valve.pressure_gain_pa_per_ma
)  # fmt: skip


def command(current_ma: float, counter: int, answers: int = 0) -> CanFrame:
    return CODEC.encode(CurrentCommand(current_ma, answers), counter)


def taken(*frames: CanFrame, state: DeviceState | None = None) -> DeviceState:
    return take(CODEC, state or initial_device(PAPER, 1), frames)


def decoded(frames: Sequence[CanFrame]) -> list[tuple[Message, int | None]]:
    return [CODEC.decode(frame) for frame in frames]


def alone_for(settings: PlantSettings, duration_s: float, current_ma: float = 12.0) -> DeviceState:
    """Return a node that got one command at the start and then none for `duration_s`."""
    state = taken(command(current_ma, 0), state=initial_device(settings, 1))
    return advance(settings, state, duration_s)


def test_a_command_is_accepted_with_its_counter_and_the_counter_that_it_answers() -> None:
    state = taken(command(9.5, 7, answers=200))
    assert (state.current_ma, state.command_counter, state.answered) == (9.5, 7, 200)


def test_the_newest_of_several_commands_counts() -> None:
    state = taken(command(9.5, 7), command(10.5, 8), command(11.5, 9))
    assert (state.current_ma, state.command_counter) == (11.5, 9)


def test_damaged_short_and_foreign_frames_leave_the_command_in_force() -> None:
    before = taken(command(9.5, 7, answers=3))
    good = command(12.0, 8)
    flipped = bytes([*good.data[:4], good.data[4] ^ 1, *good.data[5:]])
    other_valve = make_codec(WireSettings(id_offset=0x80)).encode(CurrentCommand(12.0), 8)
    for bad in (
        replace(good, data=flipped),
        replace(good, data=good.data[:7]),
        replace(good, is_error=True),
        replace(good, is_remote=True),
        replace(good, is_extended=True),
        replace(good, arbitration_id=good.arbitration_id + 1),
        other_valve,
        CODEC.encode(StemPosition(0.05), 8),
    ):
        assert taken(bad, state=before) == before, bad


@pytest.mark.parametrize("counter", [7, 5, 30])
def test_a_repeated_or_stale_command_is_not_obeyed_and_does_not_keep_the_node_alive(counter: int) -> None:
    before = advance(PAPER, taken(command(9.5, 7)), 0.05)
    after = taken(command(12.0, counter, answers=9), state=before)
    assert (after.current_ma, after.commanded_s, after.answered) == (9.5, 0.0, 0)
    assert after.command_counter == 7  # the reading goes on echoing the command that acts


def test_a_restarted_controller_is_obeyed_from_its_second_frame_on() -> None:
    state = taken(command(9.5, 100), command(12.0, 0))
    assert state.current_ma == 9.5
    assert taken(command(13.0, 1), state=state).current_ma == 13.0


def test_fresh_setpoints_are_counted_once_each() -> None:
    frames = [CODEC.encode(Setpoint(0.08), counter) for counter in (250, 251, 251, 255, 4)]
    assert taken(*frames).setpoints == 4


def test_the_truth_comes_before_the_reading_and_both_have_the_counter_of_the_sample() -> None:
    state, counters = initial_device(PAPER, 1), []
    for _ in range(300):
        state, frames = publish(CODEC, PAPER, state)
        (truth, first), (reading, second) = decoded(frames)
        assert isinstance(truth, PlantTruth)
        assert isinstance(reading, StemPosition)
        assert first == second
        counters.append(first)
    assert counters == [number % 256 for number in range(300)]
    assert state.position_counter == 300


def test_the_reading_echoes_the_counter_of_the_last_command() -> None:
    _, frames = publish(CODEC, PAPER, taken(command(9.5, 213)))
    reading = decoded(frames)[1][0]
    assert isinstance(reading, StemPosition)
    assert reading.command_counter == 213


def test_the_truth_has_no_noise_and_the_reading_has_that_of_the_sensor() -> None:
    # the spread of 2000 readings has itself an error of 1.6 %; three times that is allowed
    state = initial_device(PAPER, 1)
    readings = []
    for _ in range(2000):
        state, frames = publish(CODEC, PAPER, state)
        truth, reading = (message for message, _ in decoded(frames))
        assert isinstance(truth, PlantTruth)
        assert isinstance(reading, StemPosition)
        assert truth.position_m == pytest.approx(0.01, abs=5e-9)
        assert truth.velocity_m_per_s == 0.0
        readings.append(reading.position_m)
    spread_m = math.sqrt(sum((value - 0.01) ** 2 for value in readings) / len(readings))
    assert spread_m == pytest.approx(0.02 * 0.01, rel=0.048)


def test_values_outside_the_range_of_the_truth_saturate() -> None:
    state = initial_device(PAPER, 1)
    noiseless = plant_settings(overrides={"sensor": {"noise_of_reading": 0.0}})
    for position_m, velocity_m_per_s, shown in ((1.0, 9.0, (0.661, 8.19)), (-1.0, -9.0, (-0.01, -8.19))):
        plant = replace(state.plant, stem=Stem(position_m=position_m, velocity_m_per_s=velocity_m_per_s))
        _, frames = publish(CODEC, noiseless, replace(state, plant=plant))
        (truth, _), (reading, _) = decoded(frames)
        assert isinstance(truth, PlantTruth)
        assert isinstance(reading, StemPosition)
        assert (truth.position_m, truth.velocity_m_per_s) == pytest.approx(shown)
        assert reading.position_m == pytest.approx(position_m)


def test_before_the_first_command_the_actuator_holds_its_pressure() -> None:
    start = initial_device(PAPER, 1)
    state = advance(PAPER, start, 10.0)
    assert (state.plant.stem.position_m, state.plant.time_s) == (start.plant.stem.position_m, 10.0)
    assert state.plant.actuator.pressure_pa == pytest.approx(start.plant.actuator.pressure_pa, rel=1e-12)
    assert start.plant.actuator.pressure_pa / PAPER.valve.pressure_gain_pa_per_ma == pytest.approx(BALANCE_MA)
    assert not state.failed


def test_a_command_acts_until_the_deadman_and_not_an_instant_longer() -> None:
    for duration_s in (0.099, 0.1):
        state = alone_for(PAPER, duration_s)
        assert not state.failed
        assert state.plant == valve.step(PAPER, initial_device(PAPER, 1).plant, 12.0, duration_s)
    state = alone_for(PAPER, 0.1 + 1e-6)
    assert state.failed
    assert state.plant.actuator.pressure_pa == 0.0


def test_the_deadman_expires_inside_a_period() -> None:
    once = alone_for(PAPER, 0.25)
    held = valve.step(PAPER, initial_device(PAPER, 1).plant, 12.0, 0.1)
    assert once.plant.stem.position_m == pytest.approx(valve.step(PAPER, held, 0.0, 0.15).stem.position_m, abs=1e-12)
    assert once.plant.time_s == pytest.approx(0.25)
    in_pieces = alone_for(PAPER, 0.03)
    for _ in range(22):
        in_pieces = advance(PAPER, in_pieces, 0.01)
    assert in_pieces.plant.stem.position_m == pytest.approx(once.plant.stem.position_m, abs=1e-9)


def test_the_deadman_has_a_tolerance_of_one_picosecond() -> None:
    at_its_end = alone_for(replace(PAPER, deadman_s=0.125), 0.125)
    assert not advance(replace(PAPER, deadman_s=0.125), at_its_end, 1e-12).failed
    assert advance(replace(PAPER, deadman_s=0.125), at_its_end, 2e-12).failed


def test_commands_at_every_period_keep_the_node_alive() -> None:
    state = initial_device(PAPER, 1)
    for counter in range(50):
        state = advance(PAPER, taken(command(12.0, counter), state=state), 0.099)
        assert not state.failed


def test_the_next_command_ends_the_fail_position() -> None:
    failed = alone_for(PAPER, 0.5)
    alive = advance(PAPER, taken(command(12.0, 1), state=failed), PERIOD_S)
    assert (failed.failed, alive.failed) == (True, False)
    assert alive.plant.actuator.pressure_pa == pytest.approx(12.0 * PAPER.valve.pressure_gain_pa_per_ma)


@pytest.mark.parametrize(
    ("position", "current_ma"),
    [
        (FailPosition.CLOSE, 0.0),
        (FailPosition.OPEN, 20.0),
        (FailPosition.HOLD, 12.0),
        (FailPosition.CURRENT, 7.5),
    ],
)
def test_the_valve_goes_to_its_fail_position(position: FailPosition, current_ma: float) -> None:
    settings = replace(PAPER, fail_position=position, fail_current_ma=7.5)
    state = alone_for(settings, 5.0)
    assert state.failed
    assert state.plant.actuator.pressure_pa == pytest.approx(current_ma * PAPER.valve.pressure_gain_pa_per_ma, abs=1e-6)
    if position is FailPosition.CLOSE:  # the spring closes it until Coulomb friction is as strong
        stopped_m = PAPER.valve.coulomb_friction_n / PAPER.valve.spring_rate_n_per_m
        assert state.plant.stem.position_m == pytest.approx(stopped_m, abs=1e-4)


def test_the_deadman_has_the_length_that_the_plant_file_gives() -> None:
    settings = replace(PAPER, deadman_s=0.02)
    assert not alone_for(settings, 0.02).failed
    assert alone_for(settings, 0.0201).failed


def quality(settings: PlantSettings, state: DeviceState) -> Quality:
    _, frames = publish(CODEC, settings, state)
    reading = decoded(frames)[-1][0]
    assert isinstance(reading, StemPosition)
    return reading.quality


@pytest.mark.parametrize("position", FailPosition)
def test_a_node_whose_valve_obeys_no_command_says_so_with_every_reading(position: FailPosition) -> None:
    settings = replace(PAPER, fail_position=position)
    assert quality(settings, initial_device(settings, 1)) is Quality.FAIL_POSITION  # nothing was commanded yet
    obeying = taken(command(12.0, 0), state=initial_device(settings, 1))
    assert quality(settings, obeying) is Quality.VALID
    assert quality(settings, advance(settings, obeying, 0.1)) is Quality.VALID
    left_alone = advance(settings, obeying, 0.101)
    assert quality(settings, left_alone) is Quality.FAIL_POSITION
    assert quality(settings, taken(command(12.0, 0), state=left_alone)) is Quality.FAIL_POSITION  # a repeated command
    again = taken(command(12.0, 1), state=left_alone)
    assert quality(settings, again) is Quality.VALID
    assert quality(settings, taken(command(3.6, 2), state=again)) is Quality.FAIL_POSITION
    assert quality(settings, taken(command(3.6, 0), state=initial_device(settings, 1))) is Quality.FAIL_POSITION


# failure signals by NAMUR NE 43


@pytest.mark.parametrize("current_ma", [0.0, 3.6, 21.0, 25.0])
def test_a_failure_signal_takes_the_valve_to_its_fail_position_at_once(current_ma: float) -> None:
    before = advance(PAPER, taken(command(12.0, 0)), PERIOD_S)
    signalled = taken(command(current_ma, 1, answers=9), state=before)
    assert (signalled.current_ma, signalled.answered, signalled.failed, signalled.signal_failed) == (
        12.0,
        9,
        True,
        True,
    )
    state = advance(PAPER, signalled, PERIOD_S)
    assert state.failed
    assert state.plant == valve.step(PAPER, before.plant, 0.0, PERIOD_S)


@pytest.mark.parametrize("current_ma", [3.601, 3.8, 20.5, 20.999])
def test_a_current_that_is_no_failure_signal_is_obeyed(current_ma: float) -> None:
    state = advance(PAPER, taken(command(current_ma, 0)), PERIOD_S)
    assert not state.failed
    assert state.plant.actuator.pressure_pa == pytest.approx(current_ma * PAPER.valve.pressure_gain_pa_per_ma)


def test_a_value_ends_the_fail_position_of_a_failure_signal() -> None:
    state = taken(command(3.6, 0), command(12.0, 1))
    assert (state.failed, state.signal_failed, state.current_ma) == (False, False, 12.0)


@pytest.mark.parametrize("offset_ma", [-0.5, 0.0, 0.5])
def test_before_its_first_command_the_node_keeps_its_pressure_whatever_the_offset(offset_ma: float) -> None:
    plant = plant_settings(overrides={"actuator": {"offset_ma": offset_ma}})
    state = initial_device(plant, 0)
    later = advance(plant, state, 0.5)
    assert later.plant.actuator.pressure_pa == pytest.approx(state.plant.actuator.pressure_pa, rel=1e-14)


@pytest.mark.parametrize("pieces", [1, 4, 7])
def test_before_its_first_command_a_converter_that_drifts_off_moves_the_pressure_once(pieces: int) -> None:
    change = {"at_s": 0.25, "key": "actuator.offset_ma", "value": 0.5}
    plant = plant_settings(overrides={"schedule": [change], "actuator": {"dead_time_s": 0.1}})
    state = initial_device(plant, 0)
    start_pa = state.plant.actuator.pressure_pa
    for _ in range(pieces):
        state = advance(plant, state, 1.0 / pieces)
    drift_pa = 0.5 * plant.valve.pressure_gain_pa_per_ma
    assert state.plant.actuator.pressure_pa == pytest.approx(start_pa + drift_pa, rel=1e-12)


def test_the_fail_position_hold_keeps_the_last_current_or_before_the_first_command_the_pressure() -> None:
    holding = replace(PAPER, fail_position=FailPosition.HOLD)
    after_a_value = advance(holding, taken(command(11.0, 0), command(3.6, 1)), PERIOD_S)
    assert after_a_value.plant.actuator.pressure_pa == pytest.approx(11.0 * PAPER.valve.pressure_gain_pa_per_ma)
    at_first = advance(holding, taken(command(3.6, 0)), PERIOD_S)
    assert at_first.plant.actuator.pressure_pa == pytest.approx(BALANCE_MA * PAPER.valve.pressure_gain_pa_per_ma)
    closing = advance(PAPER, taken(command(3.6, 0)), PERIOD_S)
    assert closing.plant.actuator.pressure_pa == 0.0


def test_the_reason_and_the_fail_position_are_given_in_words() -> None:
    assert failure(PAPER, taken(command(12.0, 0))) == ""
    assert failure(PAPER, alone_for(PAPER, 0.2)) == "no command for 100 ms: fail position 'close'"
    to_current = replace(PAPER, fail_position=FailPosition.CURRENT, fail_current_ma=7.5)
    text = "the command is a failure signal: fail position 'current' (7.5 mA)"
    assert failure(to_current, taken(command(21.0, 0))) == text


def test_the_log_has_one_line_for_the_fail_position_and_one_for_its_end(
    capsys: pytest.CaptureFixture[str],
) -> None:
    options = EmulatorOptions(bus=BusAddress(), period_s=PERIOD_S, seed=1, lockstep=False)
    node = EmulatorDaemon(PAPER, CODEC, options)
    node._state = taken(command(12.0, 0), state=node._state)
    for _ in range(30):
        node._advance(0.01)
    node._state = taken(command(12.0, 1), state=node._state)
    node._advance(0.01)
    assert capsys.readouterr().err.splitlines() == [
        "plant-emulator: no command for 100 ms: fail position 'close'",
        "plant-emulator: a valid command: the valve obeys again",
    ]


def test_the_noise_of_the_pressure_sensor_is_in_the_frame_of_the_sample() -> None:
    settings = plant_settings(overrides={"sensor": {"reports_pressure": True, "pressure_noise": 0.01}})
    state, shown = initial_device(settings, 1), []
    for _ in range(400):
        state, frames = publish(CODEC, settings, state)
        (message, _), *_ = decoded(frames)
        assert isinstance(message, ActuatorState)
        shown.append(message.pressure_pa / state.plant.actuator.pressure_pa)
    assert statistics.fmean(shown) == pytest.approx(1.0, abs=0.002)
    assert statistics.stdev(shown) == pytest.approx(0.01, rel=0.15)


def test_a_pressure_sensor_reports_the_true_pressure_in_the_first_frame() -> None:
    settings = plant_settings(overrides={"sensor": {"reports_pressure": True}})
    state = initial_device(settings, 1)
    for pressure_pa, shown in ((41_000.0, 41_000.0), (-1.0, 0.0), (17e6, 16e6)):
        plant = replace(state.plant, actuator=replace(state.plant.actuator, pressure_pa=pressure_pa))
        _, frames = publish(CODEC, settings, replace(state, plant=plant, position_counter=77))
        messages = decoded(frames)
        assert [type(message) for message, _ in messages] == [ActuatorState, PlantTruth, StemPosition]
        message, counter = messages[0]
        assert isinstance(message, ActuatorState)
        assert message.pressure_pa == pytest.approx(shown)
        assert counter == 77


USERS_DBC = """VERSION ""
BU_: A B
BO_ 512 ORDER: 2 A
 SG_ Loop : 0|16@1+ (0.001,0) [0|25] "mA" B
BO_ 513 WANTED: 2 A
 SG_ Where : 0|16@1+ (0.01,0) [0|140] "mm" B
"""


def test_commands_and_setpoints_of_a_users_dbc_without_counters_are_all_accepted(tmp_path: Path) -> None:
    path = tmp_path / "user.dbc"
    path.write_text(USERS_DBC, encoding="utf-8")
    order = MessageSettings(message="ORDER", signals={"current_ma": "Loop"})
    wanted = MessageSettings(message="WANTED", signals={"setpoint_m": "Where"})
    codec = make_codec(WireSettings(dbc=path, current_command=order, setpoint=wanted))
    frames = [codec.encode(CurrentCommand(current_ma), 0) for current_ma in (9.0, 9.0, 10.0)]
    state = take(codec, initial_device(PAPER, 1), (*frames, codec.encode(Setpoint(0.08), 0)))
    assert (state.current_ma, state.command_counter, state.setpoints) == (10.0, 0, 1)
    state = take(codec, state, (codec.encode(Setpoint(0.08), 0),))
    assert state.setpoints == 2


def test_a_bad_frame_does_not_affect_the_others_of_its_batch() -> None:
    good = command(9.5, 7)
    state = taken(replace(good, data=bytes(8)), good, CODEC.encode(Setpoint(0.08), 0))
    assert (state.current_ma, state.setpoints) == (9.5, 1)


def test_setpoints_are_counted_across_the_wrap_of_their_counter() -> None:
    assert taken(*(CODEC.encode(Setpoint(0.08), counter) for counter in (255, 0, 1))).setpoints == 3


def test_held_noise_follows_the_plant_time() -> None:
    settings = plant_settings(overrides={"sensor": {"noise_hold_s": 0.01}})
    state, readings = initial_device(settings, 1), []
    for _ in range(25):
        state, frames = publish(CODEC, settings, state)
        reading = decoded(frames)[1][0]
        assert isinstance(reading, StemPosition)
        readings.append(reading.position_m)
        state = advance(settings, state, 0.001)
    assert len(set(readings)) == 3


def test_counters_of_a_users_frames_wrap_where_their_signals_end() -> None:
    codec = wire_codec(PERCENT)
    state = initial_device(PAPER, 1)
    for count in range(40):  # four bits: from 15 to 0
        state = take(codec, state, (codec.encode(CurrentCommand(9.5, position_counter=count % 16), count),))
        state = take(codec, state, (codec.encode(Setpoint(0.08), count),))
        assert (state.commands, state.setpoints) == (count + 1, count + 1)
        assert (state.command_counter, state.answered) == (count % 16, count % 16)


def test_a_repeated_frame_of_a_user_is_ignored() -> None:
    codec = wire_codec(PERCENT)
    command, setpoint = codec.encode(CurrentCommand(9.5, position_counter=3), 3), codec.encode(Setpoint(0.08), 3)
    state = take(codec, initial_device(PAPER, 1), (command, command, setpoint, setpoint))
    assert (state.commands, state.setpoints) == (1, 1)


@pytest.mark.parametrize(("zero_m", "expected_m"), [(0.1, 1.2 * 0.127), (-0.1, -0.2 * 0.127)])
def test_a_reading_beyond_the_range_of_a_users_signal_is_the_end_of_the_range(zero_m: float, expected_m: float) -> None:
    codec = wire_codec(PERCENT)
    place = {"initial_position_m": 0.07 + 0.3 * zero_m}
    settings = plant_settings("real-valve", {"valve": place, "sensor": {"zero_m": zero_m, "noise_of_span": 0.0}})
    state, frames = publish(codec, settings, initial_device(settings, 1))
    assert settings.sensor.reports_pressure
    pressure, _, reading = (message for message, _ in (codec.decode(frame) for frame in frames))
    assert isinstance(reading, StemPosition)
    assert reading.position_m == pytest.approx(expected_m, abs=1e-9)
    assert isinstance(pressure, ActuatorState)
    assert 0.0 <= pressure.pressure_pa <= 6.5e5
    assert state.position_counter == 1


def test_a_pressure_beyond_the_range_of_its_signal_is_the_end_of_the_range(tmp_path: Path) -> None:
    narrow = PERCENT.with_suffix(".dbc").read_text("ascii").replace("[0|6.5]", "[0|0.05]")
    (tmp_path / "percent.dbc").write_text(narrow, "ascii")
    (tmp_path / "percent.toml").write_text(PERCENT.read_text("utf-8"), "utf-8")
    codec = wire_codec(tmp_path / "percent.toml")
    settings = plant_settings("real-valve")
    _, frames = publish(codec, settings, initial_device(settings, 1))
    pressure, _ = codec.decode(frames[0])
    assert isinstance(pressure, ActuatorState)
    assert pressure.pressure_pa == pytest.approx(5e3)
