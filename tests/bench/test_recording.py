"""The recording of a bench: samples by their counters, losses, gaps, and a log that other tools read."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import can
import numpy as np
import pytest

from positioner.bench.frame_log import LOG_CHANNEL
from positioner.bench.modes import mode_spans
from positioner.bench.recording import Recording
from positioner.wire.codec import make_codec
from positioner.wire.messages import (
    ActuatorState,
    CanFrame,
    Cause,
    CurrentCommand,
    Health,
    Mode,
    PlantTruth,
    PositionerStatus,
    Setpoint,
    StemPosition,
)

if TYPE_CHECKING:
    from pathlib import Path

CODEC = make_codec()
PERIOD_S = 0.001
MODES = (Mode.ACTIVE, Mode.HOLD)
STATUS = PositionerStatus(Mode.ACTIVE, Cause.NONE, Health.GOOD, True, True, 0, 0, 0)


def new_recording(samples: int, *, lockstep: bool = True, samples_per_setpoint: int = 10) -> Recording:
    return Recording(CODEC, samples, PERIOD_S, samples_per_setpoint, lockstep)


def truth(counter: int, position_m: float = 0.08, velocity_m_per_s: float = 0.1) -> CanFrame:
    return CODEC.encode(PlantTruth(position_m, velocity_m_per_s), counter)


def reading(counter: int, position_m: float = 0.0801) -> CanFrame:
    return CODEC.encode(StemPosition(position_m), counter)


def command(answers: int, current_ma: float = 12.0, mode: Mode = Mode.ACTIVE) -> CanFrame:
    return CODEC.encode(CurrentCommand(current_ma, position_counter=answers % 256, mode=mode), answers)


def sample_of(counter: int) -> tuple[CanFrame, ...]:
    return truth(counter, 0.08 + 1e-5 * counter), reading(counter), command(counter, 4.0 + 0.01 * (counter % 1000))


def test_samples_of_a_loop_without_a_bus_are_those_of_the_same_frames_one_by_one() -> None:
    chance = np.random.default_rng(1)
    one_by_one, by_sample = new_recording(600), new_recording(600)
    for sample in range(600):
        frames = [
            truth(sample, chance.uniform(-0.01, 0.6), chance.uniform(-8.0, 8.0)),
            reading(sample, chance.uniform(-1.0, 1.0)),
            *([command(sample, chance.uniform(4.0, 20.0), MODES[sample // 100 % 2])] if sample != 77 else []),
            *([CODEC.encode(STATUS, sample // 100)] if sample % 100 == 0 else []),
        ]
        by_sample.add_sample(sample, frames)
        for frame in frames:
            one_by_one.add(frame, 0.0)
    by_sample.fill_columns()
    by_sample.read_modes()
    reports = one_by_one.mode_reports
    assert mode_spans(by_sample.mode_reports, 0.6, 0.1) == mode_spans(reports, 0.6, 0.1)
    assert len(by_sample.mode_reports) == len(reports) == 599 + 6
    assert by_sample.frames == one_by_one.frames
    assert by_sample.complete == one_by_one.complete == 600
    for name in ("true_position_m", "true_velocity_m_per_s", "measured_m", "current_ma"):
        expected = getattr(one_by_one, name)
        assert np.array_equal(getattr(by_sample, name), expected, equal_nan=True), name
        assert np.isfinite(np.delete(expected, 77)).all()
    assert math.isnan(by_sample.current_ma[77])


def test_every_frame_goes_to_its_sample_beyond_the_wrap_of_the_counters() -> None:
    recording = new_recording(600)
    for counter in range(600):
        for frame in sample_of(counter):
            recording.add(frame, 0.0)
    assert recording.true_position_m == pytest.approx(0.08 + 1e-5 * np.arange(600), abs=1e-8)
    assert recording.current_ma == pytest.approx(4.0 + 0.01 * np.arange(600), abs=1e-6)
    assert recording.measured_m == pytest.approx(np.full(600, 0.0801))
    assert recording.true_velocity_m_per_s == pytest.approx(np.full(600, 0.1))
    assert {report.mode for report in recording.mode_reports} == {Mode.ACTIVE}
    assert (recording.truth, recording.readings, recording.commands, recording.complete) == (600, 600, 600, 600)
    assert (recording.lost, recording.unanswered) == (0, 0)
    assert recording.time_s == pytest.approx(np.arange(600) * PERIOD_S)


def test_what_was_never_received_is_not_a_number() -> None:
    recording = new_recording(3)
    assert np.isnan(recording.true_position_m).all()
    assert np.isnan(recording.current_ma).all()
    assert recording.mode_reports == []
    assert recording.complete == 0


def test_lost_frames_are_counted_and_the_others_keep_their_samples() -> None:
    recording = new_recording(6)
    for counter in (0, 1, 4, 5):
        recording.add(truth(counter), 0.0)
        recording.add(reading(counter), 0.0)
    for counter in (0, 3, 5):
        recording.add(command(counter), 0.0)
    assert (recording.lost, recording.unanswered) == (2, 3)
    assert np.isfinite(recording.true_position_m).tolist() == [True, True, False, False, True, True]
    assert np.isfinite(recording.current_ma).tolist() == [True, False, False, True, False, True]


def test_a_command_that_repeats_its_answer_is_no_new_sample() -> None:
    recording = new_recording(5)
    for frame in (*sample_of(0), *sample_of(1), command(1, 9.0), command(0, 8.0)):
        recording.add(frame, 0.0)
    assert (recording.commands, recording.unanswered) == (2, 0)


def test_samples_beyond_the_end_are_logged_and_not_kept() -> None:
    recording = new_recording(2)
    for counter in range(4):
        for frame in sample_of(counter):
            recording.add(frame, 0.0)
    assert len(recording.frames) == 12
    assert recording.true_position_m.shape == (2,)


def test_in_real_time_the_first_truth_is_the_first_sample_and_what_comes_before_belongs_to_none() -> None:
    recording = new_recording(4, lockstep=False)
    recording.add(reading(40), 0.1)
    recording.add(command(40), 0.1)
    for counter in range(41, 44):
        for frame in sample_of(counter):
            recording.add(frame, 0.1)
    assert recording.origin == 41
    assert np.isfinite(recording.true_position_m).tolist() == [True, True, True, False]
    assert np.isfinite(recording.measured_m).tolist() == [True, True, True, False]
    assert recording.complete == 3


def test_gaps_carry_the_last_value_on_and_the_first_one_back() -> None:
    recording = new_recording(6, lockstep=False)
    recording.true_position_m[:] = [np.nan, 1.0, np.nan, np.nan, 2.0, np.nan]
    recording.fill_gaps()
    assert recording.true_position_m.tolist() == [1.0, 1.0, 1.0, 1.0, 2.0, 2.0]
    assert np.isnan(recording.current_ma).all()


def lines(path: Path) -> list[str]:
    return [line.split()[2].split("#")[0] for line in path.read_text(encoding="utf-8").splitlines()]


def test_in_lockstep_the_log_has_the_order_of_cause_and_effect_and_the_plants_time(tmp_path: Path) -> None:
    frames = [
        CODEC.encode(Setpoint(0.08), 0),
        *(frame for counter in range(3) for frame in sample_of(counter)),
        CODEC.encode(STATUS, 0),
    ]
    logs = []
    # each sender's frames keep their order, the senders' order is any
    for number, order in enumerate((frames, sorted(frames, key=lambda frame: frame.arbitration_id))):
        recording = new_recording(3)
        for frame in order:
            recording.add(frame, 123.0 + number)
        recording.write_log(tmp_path / f"{number}.log")
        logs.append((tmp_path / f"{number}.log").read_bytes())
    assert lines(tmp_path / "0.log") == ["120", "170", "110", "100", "140"] + ["170", "110", "100"] * 2
    assert logs[0] == logs[1]


def test_the_log_reads_back_frame_by_frame(tmp_path: Path) -> None:
    recording = new_recording(3)
    for counter in range(3):
        for frame in sample_of(counter):
            recording.add(frame, 0.0)
    recording.write_log(tmp_path / "bus.log")
    read = list(can.LogReader(tmp_path / "bus.log"))
    assert [(message.arbitration_id, bytes(message.data)) for message in read] == [
        (frame.arbitration_id, frame.data) for counter in range(3) for frame in sample_of(counter)
    ]
    assert [message.timestamp for message in read] == pytest.approx(np.repeat([0.0, 0.001, 0.002], 3))
    assert {message.channel for message in read} == {LOG_CHANNEL}


def test_in_real_time_the_log_has_the_order_and_time_of_arrival(tmp_path: Path) -> None:
    recording = new_recording(2, lockstep=False)
    for instant_s, frame in ((0.1, truth(0)), (0.3, command(0)), (0.2, reading(0))):
        recording.add(frame, instant_s)
    recording.write_log(tmp_path / "bus.log")
    assert lines(tmp_path / "bus.log") == ["170", "110", "100"]


def test_a_frame_of_an_unknown_sender_is_logged_as_it_came(tmp_path: Path) -> None:
    recording = new_recording(1)
    recording.add(CanFrame(0x7DF, b"\x02\x01"), 0.5)
    recording.add(CanFrame(0x18FF0102, b"\x03", is_extended=True), 0.6)
    recording.write_log(tmp_path / "bus.log")
    assert [line.split()[2] for line in (tmp_path / "bus.log").read_text(encoding="utf-8").splitlines()] == [
        "7DF#0201",
        "18FF0102#03",
    ]
    assert recording.complete == 0


def test_statuses_keep_their_time_beyond_the_wrap_of_their_counter() -> None:
    # at ten a second the counter wraps after 25.6 s
    recording = new_recording(40_000)
    for number in range(300):
        recording.add(CODEC.encode(STATUS, number), 0.0)
    assert [stamp_s for stamp_s, _, _ in recording.frames] == pytest.approx(np.arange(300) * 0.1)


def test_setpoints_stand_at_the_samples_they_belong_to() -> None:
    recording = new_recording(100, samples_per_setpoint=20)
    for number in range(5):
        recording.add(CODEC.encode(Setpoint(0.08), number), 0.0)
    assert [stamp_s for stamp_s, _, _ in recording.frames] == pytest.approx(np.arange(5) * 0.02)


def test_a_pressure_stands_before_the_truth_of_its_sample() -> None:
    recording = new_recording(3)
    for counter in range(3):
        recording.add(CODEC.encode(ActuatorState(4e4), counter), 0.0)
        recording.add(truth(counter), 0.0)
    assert [stamp_s for stamp_s, _, _ in recording.frames] == pytest.approx(np.repeat([0.0, 0.001, 0.002], 2))
    ranks = [rank for _, rank, _ in recording.frames]
    assert ranks[0] < ranks[1]
