"""A log may be longer than the memory: it is read in passes, and nothing of it is kept."""

from __future__ import annotations

import csv
from dataclasses import replace
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np
import pytest
import replay_helpers as runs
from endurance import long_replay
from hypothesis import given
from hypothesis import strategies as st

from positioner.cycle.events import LawFellBack
from positioner.replay.cycles import cycles_of
from positioner.replay.envelope import MOST_PARTS, Envelope
from positioner.replay.log import LogError, LogFrame, read_log
from positioner.replay.other import OtherLaw, Row
from positioner.replay.output import OutputFolder
from positioner.replay.recorded import MOST_FRAMES, FrameClassifier, RecordedCycle
from positioner.replay.run import ReplayedCycle
from positioner.replay.survey import LogKind, Survey
from positioner.runtime.record import NOTE_ID
from positioner.wire.codec import make_codec
from positioner.wire.messages import CanFrame, Cause, CurrentCommand, Mode, Setpoint, StemPosition

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

CODEC = make_codec()
CLASSIFIER = FrameClassifier(CODEC)
PERIOD_NS = 1_000_000
MOST_GROWTH_MIB = 4.0
MOST_MIB = 256.0
STRETCHES = 64


@pytest.mark.slow(short="test_the_cycles_follow_the_frames_at_a_bounded_distance")
def test_a_log_of_four_times_the_frames_takes_no_more_memory(tmp_path: Path) -> None:
    short, long = (long_replay.replay(frames, tmp_path) for frames in (10_000, 40_000))
    assert "a log of the bus, 40000 frames, 19048 position frames" in long.text
    assert long.undrawn_mib - short.undrawn_mib < MOST_GROWTH_MIB, (short, long)
    assert long.peak_mib < MOST_MIB
    with (tmp_path / "out" / "trace.csv").open(encoding="utf-8", newline="") as file:
        assert sum(1 for _ in csv.DictReader(file)) == 19_048


class Source:
    """Frames that are made when they are asked for."""

    def __init__(self) -> None:
        self.given = 0

    def sample(self, number: int, setpoint: int = 0) -> Iterator[LogFrame]:
        reading = CODEC.encode(StemPosition(0.08), number % 256)
        command = CurrentCommand(12.0, position_counter=number % 256, setpoint_counter=setpoint % 256)
        yield self.frame(number * PERIOD_NS, reading)
        yield self.frame(number * PERIOD_NS, CODEC.encode(command, number % 256))

    def frame(self, time_ns: int, frame: CanFrame, *, sent: bool = False) -> LogFrame:
        self.given += 1
        return LogFrame(self.given, time_ns, frame, sent)


@pytest.mark.parametrize("kind", list(LogKind))
def test_the_cycles_follow_the_frames_at_a_bounded_distance(kind: LogKind) -> None:
    source, taken = Source(), 0
    frames = (frame for number in range(MOST_FRAMES) for frame in source.sample(number))
    for cycle in cycles_of(kind, CLASSIFIER, frames, PERIOD_NS):
        taken += len(cycle.inbox) + len(cycle.outbox)
        assert source.given - taken <= MOST_FRAMES + 2
    assert source.given == 2 * MOST_FRAMES
    assert taken in {source.given, source.given // 2}  # what nobody sent and no positioner receives is in no cycle


@pytest.mark.parametrize("kind", [LogKind.RECORD, LogKind.LOCKSTEP])
def test_frames_of_one_instant_without_end_are_many_cycles(kind: LogKind) -> None:
    source = Source()
    setpoint = CODEC.encode(Setpoint(0.08), 0)
    cycles = cycles_of(kind, CLASSIFIER, (source.frame(0, setpoint) for _ in range(3 * MOST_FRAMES)), PERIOD_NS)
    assert [len(cycle.inbox) for cycle in cycles] == [MOST_FRAMES] * 3


def setpoints(source: Source, count: int) -> Iterator[LogFrame]:
    return (source.frame(source.given, CODEC.encode(Setpoint(0.08), number % 256)) for number in range(count))


def test_of_a_host_alone_on_the_bus_every_frame_counts_until_the_first_command_of_the_positioner() -> None:
    source, many = Source(), 2 * MOST_FRAMES + 5
    before = [*setpoints(source, many), *source.sample(0, many - 1)]
    sizes = [len(cycle.inbox) for cycle in cycles_of(LogKind.BUS, CLASSIFIER, before, PERIOD_NS)]
    assert sizes == [MOST_FRAMES, MOST_FRAMES, 6]
    source = Source()
    after = [*source.sample(0), *setpoints(source, many), *source.sample(1, many - 1)]
    first, last = cycles_of(LogKind.BUS, CLASSIFIER, after, PERIOD_NS)
    assert len(first.inbox) == 1
    assert MOST_FRAMES // 2 < len(last.inbox) <= MOST_FRAMES
    assert last.inbox[-1].number == len(after) - 1


@st.composite
def logs(draw: st.DrawFn) -> list[LogFrame]:
    """A listener's log with frames that are lost, doubled, late, and another controller's."""
    source, found = Source(), []
    for number in range(draw(st.integers(1, 80))):
        for frame in source.sample(number):
            copies = draw(st.sampled_from((1, 1, 1, 1, 1, 0, 2)))
            late_ns = draw(st.sampled_from((0, 0, 420_000, 3_000_000)))
            found += [replace(frame, time_ns=frame.time_ns + late_ns)] * copies
        if draw(st.integers(0, 9)) == 0:
            foreign = CODEC.encode(CurrentCommand(9.0), draw(st.integers(0, 255)))
            found.append(source.frame(number * PERIOD_NS, foreign))
        if draw(st.integers(0, 3)) == 0:
            found.append(source.frame(number * PERIOD_NS, CODEC.encode(Setpoint(0.08), draw(st.integers(0, 255)))))
    found.sort(key=lambda frame: frame.time_ns)
    return [replace(frame, number=number) for number, frame in enumerate(found, start=1)]


@given(log=logs())
def test_whatever_is_lost_or_doubled_no_frame_is_in_two_cycles_and_none_answers_what_came_later(
    log: list[LogFrame],
) -> None:
    cycles = list(cycles_of(LogKind.BUS, CLASSIFIER, log, PERIOD_NS))
    inputs = [frame.number for cycle in cycles for frame in cycle.inbox]
    assert len(set(inputs)) == len(inputs)
    closing = [frame.number for cycle in cycles for frame in cycle.outbox]
    assert closing == sorted(set(closing))
    assert not set(inputs) & set(closing)
    for cycle in cycles:
        assert [frame.number for frame in cycle.inbox] == sorted(frame.number for frame in cycle.inbox)
        assert all(frame.number < command.number for frame in cycle.inbox for command in cycle.outbox)


def survey_of(frames: Iterable[LogFrame]) -> Survey:
    survey = Survey(CLASSIFIER, PERIOD_NS)
    for frame in frames:
        survey.add(frame)
    return survey


def test_a_first_pass_finds_the_kind_of_log() -> None:
    source = Source()
    lockstep = [frame for number in range(20) for frame in source.sample(number)]
    assert survey_of(lockstep).kind is LogKind.LOCKSTEP
    assert survey_of(lockstep[::2]).kind is LogKind.BUS
    assert survey_of([replace(frame, time_ns=frame.time_ns + 9000) for frame in lockstep]).kind is LogKind.BUS
    late = [replace(frame, time_ns=frame.time_ns + PERIOD_NS * CLASSIFIER.is_command(frame)) for frame in lockstep]
    assert survey_of(late).kind is LogKind.BUS
    assert survey_of([*lockstep[:-1], replace(lockstep[-1], sent=True)]).kind is LogKind.RECORD
    assert (
        survey_of([replace(frame, sent=CLASSIFIER.is_position(frame)) for frame in lockstep]).kind is LogKind.LOCKSTEP
    )


def test_a_note_of_another_length_is_none() -> None:
    whole = CanFrame(NOTE_ID, bytes(8), is_extended=True)
    assert CLASSIFIER.concerns(LogFrame(1, 0, whole, sent=True))
    assert not CLASSIFIER.concerns(LogFrame(1, 0, replace(whole, data=b""), sent=True))


def test_a_log_that_loses_its_end_between_two_passes_is_reported(tmp_path: Path) -> None:
    path, _ = runs.write_bench_log(tmp_path, runs.scenario("pi", seconds=0.03))
    log = read_log(path)
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join([*lines, lines[-1]]))
    assert sum(1 for _ in log.frames()) == log.count == len(lines)  # one that grows is replayed as it was
    path.write_bytes(b"".join(lines[:40]))
    with pytest.raises(LogError, match=f"changed while it was read: of {len(lines)} frames it holds 40 now"):
        list(log.frames())


@given(st.integers(1, 5 * STRETCHES), st.integers(0, 2**32 - 1))
def test_a_long_curve_keeps_its_peaks_in_a_bounded_number_of_points(samples: int, seed: int) -> None:
    values = np.random.default_rng(seed).normal(size=samples)
    peak = int(np.argmax(np.abs(values)))
    envelope = Envelope(2, STRETCHES)
    for number, value in enumerate(values):
        envelope.append(float(number), (float(value), None if number % 2 else 1.0))
    time_s, lines = envelope.lines()
    assert len(time_s) == len(lines) <= 2 * STRETCHES
    if samples <= STRETCHES:
        assert (time_s == np.arange(samples)).all()
        assert (lines[:, 0] == values).all()
        assert np.isnan(lines[1::2, 1]).all()
    assert values[peak] in lines[:, 0]
    where = float(time_s[lines[:, 0] == values[peak]][0])
    assert where <= peak < where + 8
    assert lines[0, 1] == 1.0
    assert (np.diff(time_s) >= 0.0).all()


def test_every_row_of_a_long_trace_is_written(tmp_path: Path) -> None:
    row = Row(0.0, 0.08, 0.081, 12.0, None, Mode.ACTIVE, Mode.HOLD, "", "a, b")
    with OutputFolder(tmp_path) as output:
        for number in range(MOST_PARTS + 1000):
            output.add(replace(row, time_s=number * 1e-3))
    output.draw("long")
    lines = (tmp_path / "trace.csv").read_text(encoding="utf-8").splitlines()
    assert lines[-1] == f"{(MOST_PARTS + 999) * 1e-3:.6f},0.08000000,0.08100000,12.00000000,,2,3,,a; b"
    assert len(lines) == MOST_PARTS + 1001
    assert (tmp_path / "replay.png").read_bytes().startswith(b"\x89PNG")


def test_fallbacks_of_ever_new_reasons_are_counted_and_not_all_remembered() -> None:
    other = OtherLaw(CODEC)
    for number in range(5000):
        other.add(
            ReplayedCycle(
                RecordedCycle(number, ()), (), (LawFellBack(f"gap of {number} mm"),), Mode.ACTIVE, Cause.NONE, None
            )
        )
    lines = other.in_words().splitlines()
    assert "fallbacks: 5000" in lines
    assert len(other.fallbacks) <= 1001
    assert "  4000 × for other reasons" in lines


def test_lines_of_the_long_log_are_a_listener_s() -> None:
    frames = list(islice(long_replay.lines(), 21))
    assert len({line.split()[0] for line in frames}) == 20
