"""The positioner's own record, cycle by cycle and by the instants of the cycles; the logs that benches write."""

from __future__ import annotations

import signal
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING

import can
import pytest
import replay_helpers as runs
from daemon_helpers import Loop, own_address

from positioner.bench.play import BenchOptions
from positioner.bench.recording import Recording
from positioner.bench.runner import run_bench
from positioner.bench.truth_log import add_truth
from positioner.bus.port import BusPort
from positioner.cli.main import main
from positioner.config.reader import load_config
from positioner.cycle.alarms import packed
from positioner.cycle.input import CycleInput
from positioner.guard.state import GuardState, LawRecord
from positioner.machine.journal import logger
from positioner.replay import recorded
from positioner.replay.cycles import cycles_of
from positioner.replay.log import read_log
from positioner.replay.prepare import prepare
from positioner.replay.survey import LogKind, Survey
from positioner.runtime.clock import RealClock
from positioner.runtime.record import NOTE_ID, BusRecorder, Note
from positioner.runtime.session import RunOptions
from positioner.valve.stiction import Direction, Quantity, StictionTable
from positioner.wire.codec import make_codec
from positioner.wire.messages import CanFrame, Cause, CurrentCommand, Health, Mode, PlantTruth, Setpoint, StemPosition

if TYPE_CHECKING:
    Output = pytest.CaptureFixture[str]

FRAME = CanFrame(0x110, bytes(range(8)))
HELD = GuardState(Mode.HOLD, Cause.FEEDBACK_STALE)


def lines(path: Path) -> list[str]:
    return path.read_text(encoding="ascii").splitlines()


def test_a_cycle_is_its_frames_under_one_instant(tmp_path: Path) -> None:
    recorder = BusRecorder(tmp_path / "bus.log")
    inbox = (FRAME, CanFrame(0x1ABCDE, b"\x01", is_extended=True), CanFrame(0x123, b"", is_remote=True))
    recorder.cycle(CycleInput(inbox, 12_000_345_000), (CanFrame(0x100, b"\xff"),), HELD)
    recorder.cycle(CycleInput((CanFrame(0, b"", is_error=True),), 13_000_000_001), (), HELD)
    recorder.close()
    assert lines(tmp_path / "bus.log") == [
        "(12.000345) vcan0 110#0001020304050607 R",
        "(12.000345) vcan0 001ABCDE#01 R",
        "(12.000345) vcan0 123#R R",
        "(12.000345) vcan0 100#FF T",
        "(13.000000001) vcan0 20000080#0000000000000000 R",
    ]
    read = list(can.LogReader(tmp_path / "bus.log"))
    assert [message.is_rx for message in read] == [True, True, True, False, True]
    assert [message.is_extended_id for message in read[:4]] == [False, True, False, False]
    assert read[2].is_remote_frame
    assert read[4].is_error_frame


def test_an_empty_cycle_is_noted_where_it_moves_the_guard(tmp_path: Path) -> None:
    recorder = BusRecorder(tmp_path / "bus.log")
    recorder.cycle(CycleInput((), 1_000_000), (), GuardState())
    recorder.cycle(CycleInput((), 2_000_000), (), HELD)
    recorder.cycle(CycleInput((), 3_000_000), (), replace(HELD, law=LawRecord(late_cycles=1)))
    recorder.close()
    empty = f"vcan0 {NOTE_ID:08X}#FE00000000000000 T"
    assert lines(tmp_path / "bus.log") == [f"(0.002000) {empty}", f"(0.003000) {empty}"]


def test_what_a_cycle_is_given_besides_frames_is_noted_before_them(tmp_path: Path) -> None:
    recorder = BusRecorder(tmp_path / "bus.log")
    table = StictionTable().record(Quantity.BREAKAWAY_CURRENT, 0.08, Direction.OPENING, 14.0)
    usual = CycleInput((FRAME,), 1_000_000)
    unsaved = replace(usual, table_saved=False)
    for cycle_input in (usual, unsaved, unsaved, replace(unsaved, late_ns=0x1234), replace(unsaved, table=table)):
        recorder.cycle(cycle_input, (), HELD)
    recorder.close()
    noted = [line.split()[2] for line in lines(tmp_path / "bus.log")]
    frame = "110#0001020304050607"
    expected = [frame, "1FFFFFFF#0000000000000000", frame, frame]
    expected += ["1FFFFFFF#0134120000000000", frame, "1FFFFFFF#FF00000000000000", frame]
    assert noted == expected
    assert Note.of(Note(3, 0x123456789ABCDE).data) == Note(3, 0x123456789ABCDE)


def test_alarms_are_noted_where_they_change(tmp_path: Path) -> None:
    recorder = BusRecorder(tmp_path / "bus.log")
    usual = CycleInput((FRAME,), 1_000_000)
    told = replace(usual, alarms=packed(Health.FAILURE, 0x1001, 0x0001))
    for cycle_input in (usual, told, told, usual):
        recorder.cycle(cycle_input, (), HELD)
    recorder.close()
    noted = [line.split()[2] for line in lines(tmp_path / "bus.log")]
    frame = "110#0001020304050607"
    assert noted == [frame, "1FFFFFFF#0401100100040000", frame, frame, "1FFFFFFF#0400000000000000", frame]


def test_what_comes_in_after_something_was_sent_belongs_to_the_next_cycle(tmp_path: Path) -> None:
    # a daemon in lockstep may take two cycles at one instant: only a position frame makes time pass
    codec = make_codec()
    reading, command, setpoint = (
        codec.encode(message, 0) for message in (StemPosition(0.08), CurrentCommand(12.0), Setpoint(0.08))
    )
    recorder = BusRecorder(tmp_path / "bus.log")
    recorder.cycle(CycleInput((reading,), 1_000_000), (command,), HELD)
    recorder.cycle(CycleInput((setpoint,), 1_000_000), (), HELD)
    recorder.close()
    classifier = recorded.FrameClassifier(codec)
    survey = Survey(classifier, 1_000_000)
    log = read_log(tmp_path / "bus.log", survey.add)
    assert survey.kind is LogKind.RECORD
    cycles = list(cycles_of(survey.kind, classifier, log.frames(), 1_000_000))
    assert [[frame.frame.data for frame in cycle.inbox] for cycle in cycles] == [[reading.data], [setpoint.data]]
    assert [[frame.frame.data for frame in cycle.outbox] for cycle in cycles] == [[command.data], []]


def test_the_daemon_notes_that_its_last_cycle_was_late(
    tmp_path: Path, capsys: Output, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = tmp_path / "bus.log"
    with Loop(tmp_path, RunOptions(record=log), guard={"auto_arm": True}) as loop:
        gap = SimpleNamespace(gap_ns=0)
        monkeypatch.setattr(Loop, "is_real", True)
        monkeypatch.setattr(BusPort, "gap_ns", property(lambda _port: gap.gap_ns))
        loop.elapsed_ns = time.monotonic_ns()
        for gap.gap_ns in (0, 0, 0, 30_000_000, 0, 0):
            loop.sample()
        loop.close()
    notes = [line.split()[2] for line in lines(log) if f"{NOTE_ID:X}#" in line]
    assert f"{NOTE_ID:X}#{Note(1, 30_000_000).data.hex().upper()}" in notes
    assert main(["replay", str(log), "--config", str(tmp_path / "valve.toml")]) == 0
    assert "the positioner's own record" in capsys.readouterr().out


def test_a_full_disk_ends_the_record_and_nothing_else(monkeypatch: pytest.MonkeyPatch) -> None:
    lines: list[str] = []
    monkeypatch.setattr(logger, "error", lambda form, *words: lines.append(form % words))
    recorder = BusRecorder(Path("/dev/full"))
    for cycle in range(3000):
        recorder.cycle(CycleInput((FRAME,), cycle * 1_000_000), (), HELD)
    recorder.close()
    assert lines == ["the record ends here: No space left on device"]


def test_without_a_path_nothing_is_recorded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    recorder = BusRecorder(None)
    recorder.cycle(CycleInput((FRAME,), 0), (), HELD)
    recorder.close()
    assert list(tmp_path.iterdir()) == []


def test_the_real_clock_counts_in_microseconds_as_a_log_does() -> None:
    clock = RealClock()
    instants = [clock.now_ns(()) for _ in range(100)]
    assert all(instant % 1000 == 0 for instant in instants)
    assert instants == sorted(instants)


@pytest.mark.parametrize(("law", "seed"), [("nmpc", 5), ("pi", 1)])
def test_a_run_through_every_fault_is_identical(law: str, seed: int, tmp_path: Path, capsys: Output) -> None:
    played = runs.scenario(law, seconds=3.0, seed=seed, auto_arm=False)
    log, config = runs.record_faults(tmp_path, played)
    assert main(["replay", str(log), "--config", str(config)]) == 0
    output = capsys.readouterr().out
    assert "the positioner's own record" in output
    assert "identical" in output
    # without the notes, neither the store's trouble nor a late cycle could be known
    log.write_text("".join(f"{line}\n" for line in lines(log) if f"{NOTE_ID:X}#" not in line), encoding="ascii")
    assert main(["replay", str(log), "--config", str(config)]) == 1
    output = capsys.readouterr().out
    assert "table saved False recorded, True computed" in output or "counted LAW_LATE" in output


def test_a_listener_s_log_of_a_run_through_every_fault_is_identical_in_its_commands(
    tmp_path: Path, capsys: Output
) -> None:
    log, config = runs.record_faults(tmp_path, runs.scenario("pi", seconds=3.0, auto_arm=False))
    received = []
    for line in lines(log):
        stamp, channel, frame, direction = line.split()
        if not frame.startswith(f"{NOTE_ID:X}"):
            stamp_s = float(stamp[1:-1]) + (0.0003 if direction == "T" else 0.0)
            received.append((stamp_s, f"({stamp_s:.6f}) {channel} {frame}\n"))
    log.write_text("".join(line for _, line in sorted(received, key=lambda each: each[0])), encoding="ascii")
    assert main(["replay", str(log), "--config", str(config)]) == 0
    output = capsys.readouterr().out
    assert "a log of the bus" in output
    assert "POSITIONER_STATUS" not in output


def test_a_table_that_was_replaced_meanwhile_is_reported(tmp_path: Path, capsys: Output) -> None:
    log, config = runs.record_faults(tmp_path, runs.scenario("pi", seconds=0.3, auto_arm=False))
    written = lines(log)
    note = f"(0.100000) vcan0 {NOTE_ID:08X}#{Note(0xFF).data.hex().upper()} T"
    at = next(index for index, line in enumerate(written) if line.startswith("(0.1"))
    log.write_text("\n".join([*written[:at], note, *written[at:]]) + "\n", encoding="ascii")
    assert main(["replay", str(log), "--config", str(config)]) == 0
    assert "the stiction table was replaced at 0.1" in capsys.readouterr().out


def test_the_truth_is_merged_by_time_and_the_log_starts_at_zero(tmp_path: Path) -> None:
    codec = make_codec()
    recording = Recording(codec, 2, 0.001, 1, lockstep=False, begin_ns=5_000_000_000)
    truth = [codec.encode(PlantTruth(0.08, 0.0), counter) for counter in (0, 1)]
    recording.add(truth[0], 0.0005)
    recording.add(truth[1], 0.0015)
    recorder = BusRecorder(tmp_path / "bus.log")
    recorder.cycle(CycleInput((FRAME,), 5_000_200_000), (), HELD)
    recorder.cycle(CycleInput((FRAME,), 5_001_000_000), (), HELD)
    recorder.close()
    add_truth(tmp_path / "bus.log", recording)
    assert [line.split(" vcan0 ")[0] for line in lines(tmp_path / "bus.log")] == [
        "(0.000000)", "(0.000300)", "(0.000800)", "(0.001300)"
    ]  # fmt: skip
    assert [line.split()[2][:3] for line in lines(tmp_path / "bus.log")] == ["110", "170", "110", "170"]


def test_a_record_of_a_dry_run_is_refused(capsys: Output) -> None:
    assert main(["run", "--config", "absent.toml", "--dry-run", "--record", "bus.log"]) == 2
    assert "--record stores the frames that are sent, and --dry-run sends none" in capsys.readouterr().err


@pytest.mark.bus
@pytest.mark.parametrize("lockstep", [True, False], ids=["lockstep", "realtime"])
def test_the_log_that_a_bench_leaves_is_identical(lockstep: bool, tmp_path: Path, capsys: Output) -> None:
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    out = tmp_path / "out"
    played = replace(runs.scenario(seconds=0.9), sample_period_s=0.01)
    options = BenchOptions(bus=own_address(), lockstep=lockstep, out=out, state=None)
    run_bench(played, options, lambda _line: None)
    assert main(["replay", str(out / "bus.log"), "--config", str(out / "valve.toml")]) == 0
    session = prepare(out / "bus.log", load_config(out / "valve.toml"), None)
    assert session.kind is (LogKind.LOCKSTEP if lockstep else LogKind.RECORD)
    assert session.readings >= (90 if lockstep else 1)
    assert not (out / "state-before").exists()
    if not lockstep:
        return
    # the next run begins with the table of this one, and leaves a copy of it: only from there it is the same
    run_bench(replace(played, seed=2), replace(options, state=out / "state"), lambda _line: None)
    assert (
        main(
            ["replay", str(out / "bus.log"), "--config", str(out / "valve.toml"), "--state", str(out / "state-before")]
        )
        == 0
    )
    assert "identical" in capsys.readouterr().out
