"""Replay: the frames of a log go through the same cycle, and the first difference is reported."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import pytest
import replay_helpers as runs

from positioner.cli.main import main
from positioner.config.reader import load_config
from positioner.replay.prepare import prepare
from positioner.replay.recorded import INPUTS, FrameClassifier
from positioner.replay.survey import LogKind
from positioner.runtime import session
from positioner.wire import e2e
from positioner.wire.codec import make_codec
from positioner.wire.messages import CurrentCommand, StemPosition

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    Output = pytest.CaptureFixture[str]

CODEC = make_codec()
COMMAND_DATA_ID = CODEC.by_kind[CurrentCommand].data_id
POSITION_DATA_ID = CODEC.by_kind[StemPosition].data_id


def altered(log: Path, number: int, change: Callable[[bytes], bytes]) -> None:
    """Change the data of frame `number` (from 1) of a candump log."""
    lines = log.read_text(encoding="ascii").splitlines()
    head, rest = lines[number - 1].split("#")
    data, direction = rest.split()
    lines[number - 1] = f"{head}#{change(bytes.fromhex(data)).hex().upper()} {direction}"
    log.write_text("\n".join(lines) + "\n", encoding="ascii")


def numbers_of(log: Path, identifier: str) -> list[int]:
    """Return the numbers of the frames with `identifier`."""
    lines = log.read_text(encoding="ascii").splitlines()
    return [number for number, line in enumerate(lines, start=1) if f" {identifier}#" in line]


def on_the_bus(log: Path, *, delay_s: float = 0.00042) -> None:
    """Rewrite the log of a lockstep bench as a listener's: without truth, and what the positioner sends comes later."""
    stamped = []
    for line in log.read_text(encoding="ascii").splitlines():
        stamp_s, channel, frame, _ = line.split()
        late_s = delay_s if frame[:3] in {"100", "140"} else 0.0001 if frame[:3] == "110" else 0.0
        if frame[:3] != "170":
            stamped.append((1.7e9 + float(stamp_s[1:-1]) + late_s, f"{channel} {frame}"))
    stamped.sort(key=lambda each: each[0])
    log.write_text("".join(f"({stamp_s:.6f}) {rest}\n" for stamp_s, rest in stamped), encoding="ascii")


@pytest.mark.parametrize("law", ["nmpc", "paper", "pi", "two-move-retry"])
def test_the_log_of_a_bench_in_lockstep_is_identical(law: str, tmp_path: Path, capsys: Output) -> None:
    log, config = runs.write_bench_log(tmp_path, runs.scenario(law))
    assert main(["replay", str(log), "--config", str(config)]) == 0
    output = capsys.readouterr().out.splitlines()
    frames = len(log.read_text(encoding="ascii").splitlines())
    assert output[0] == f"{log}: the log of a lockstep bench, {frames} frames, 300 position frames"
    assert output[1] == "CURRENT_COMMAND: 300 recorded, 300 computed, 300 equal to the bit"
    assert output[2] == "POSITIONER_STATUS: 3 recorded, 3 computed, 3 equal to the bit"
    assert output[-1] == "identical"


def test_a_period_of_no_whole_microseconds_is_as_exact(tmp_path: Path, capsys: Output) -> None:
    # a rate limit makes every current hang on the exact length of the period
    played = replace(
        runs.scenario(max_rate_ma_per_s=1000.0),
        sample_period_s=1.0 / 1500.0,
        setpoint_period_s=0.01,
        setpoints_mm=(73.0, 87.0),
        dwell_s=0.3,
    )
    log, config = runs.write_bench_log(tmp_path, played)
    assert main(["replay", str(log), "--config", str(config)]) == 0
    assert "CURRENT_COMMAND: 900 recorded, 900 computed, 900 equal" in capsys.readouterr().out


def test_an_altered_command_is_reported_with_its_meaning(tmp_path: Path, capsys: Output) -> None:
    log, config = runs.write_bench_log(tmp_path, runs.scenario())
    number = numbers_of(log, "100")[150]

    def heavier(data: bytes) -> bytes:
        current = int.from_bytes(data[3:6], "little")  # in µA, little-endian, behind CRC and counter
        return e2e.protect(data[:3] + (current ^ 0x10).to_bytes(3, "little") + data[6:], COMMAND_DATA_ID or 0)

    altered(log, number, heavier)
    assert main(["replay", str(log), "--config", str(config)]) == 1
    output = capsys.readouterr().out.splitlines()
    assert output[1] == "CURRENT_COMMAND: 300 recorded, 300 computed, 299 equal to the bit, 1 differ"
    assert output[-4] == f"first difference: CURRENT_COMMAND at 0.150000 s, frame {number}, id 100"
    assert output[-3].startswith("  recorded  ")
    assert output[-2].startswith("  computed  ")
    words = output[-1].split()
    assert words[0] == "current"
    assert words[2:] == ["mA", "recorded,", words[4], "mA", "computed"]
    assert round(abs(float(words[1]) - float(words[4])), 3) == 0.016


def test_a_damaged_command_in_the_log_is_reported_as_damaged(tmp_path: Path, capsys: Output) -> None:
    log, config = runs.write_bench_log(tmp_path, runs.scenario())
    altered(log, numbers_of(log, "100")[20], lambda data: data[:4] + bytes((data[4] ^ 1,)) + data[5:])
    assert main(["replay", str(log), "--config", str(config)]) == 1
    output = capsys.readouterr().out
    assert "299 equal to the bit, 1 differ" in output
    assert "the recorded frame is not valid: wrong CRC: CURRENT_COMMAND data" in output


def test_an_altered_reading_makes_the_command_that_answers_it_the_first_to_differ(
    tmp_path: Path, capsys: Output
) -> None:
    log, config = runs.write_bench_log(tmp_path, runs.scenario("pi"))

    def higher(data: bytes) -> bytes:
        return e2e.protect(data[:4] + bytes((data[4] ^ 0x40,)) + data[5:], POSITION_DATA_ID or 0)

    altered(log, numbers_of(log, "110")[190], higher)
    assert main(["replay", str(log), "--config", str(config)]) == 1
    output = capsys.readouterr().out
    assert f"first difference: CURRENT_COMMAND at 0.190000 s, frame {numbers_of(log, '100')[190]}, id 100" in output
    assert "mA recorded" in output
    counts = next(line for line in output.splitlines() if line.startswith("CURRENT_COMMAND")).split()
    assert counts[1:5] == ["300", "recorded,", "300", "computed,"]
    assert 190 <= int(counts[5]) < 300


def test_a_command_that_is_missing_from_the_log_is_reported(tmp_path: Path, capsys: Output) -> None:
    log, config = runs.write_bench_log(tmp_path, runs.scenario())
    lines = log.read_text(encoding="ascii").splitlines()
    del lines[numbers_of(log, "100")[30] - 1]
    log.write_text("\n".join(lines) + "\n", encoding="ascii")
    assert main(["replay", str(log), "--config", str(config)]) == 1
    output = capsys.readouterr().out
    assert "CURRENT_COMMAND: 299 recorded, 300 computed, 299 equal to the bit, 1 differ" in output
    assert "first difference: CURRENT_COMMAND at 0.030000 s, id 100\n  recorded  nothing\n  computed  " in output


def test_another_configuration_differs(tmp_path: Path, capsys: Output) -> None:
    log, config = runs.write_bench_log(tmp_path, runs.scenario("pi"))
    config.write_text(runs.text_of(runs.scenario("knocker")), encoding="utf-8")
    assert main(["replay", str(log), "--config", str(config)]) == 1
    assert "first difference: CURRENT_COMMAND" in capsys.readouterr().out


@pytest.mark.parametrize("delay_s", [0.00042, 0.0018])
def test_a_listener_s_log_is_replayed_by_the_echoes(delay_s: float, tmp_path: Path, capsys: Output) -> None:
    # with 1.8 ms every command stands behind the next reading: only its echo shows which one it answers
    log, config = runs.write_bench_log(tmp_path, runs.scenario())
    on_the_bus(log, delay_s=delay_s)
    assert main(["replay", str(log), "--config", str(config)]) == 0
    output = capsys.readouterr().out
    assert "a log of the bus" in output
    assert "CURRENT_COMMAND: 300 recorded, 300 computed, 300 equal to the bit\n" in output
    assert "POSITIONER_STATUS" not in output
    assert "not compared" in output


def test_readings_that_one_command_answers_were_one_batch(tmp_path: Path, capsys: Output) -> None:
    log, config = runs.write_bench_log(tmp_path, runs.scenario("pi"))
    on_the_bus(log)
    lines = log.read_text(encoding="ascii").splitlines()
    at = next(index for index, line in enumerate(lines) if "(1700000000.100" in line and " 100#" in line)
    del lines[at]  # as if the positioner had missed a reading: its later counters would then differ
    log.write_text("\n".join(lines) + "\n", encoding="ascii")
    prepared = prepare(log, load_config(config), None)
    assert prepared.kind is LogKind.BUS
    classifier = FrameClassifier(CODEC)
    sizes = [sum(classifier.is_position(frame) for frame in cycle.inbox) for cycle in prepared.cycles()]
    assert sizes == [1] * 100 + [2] + [1] * 198
    assert main(["replay", str(log), "--config", str(config)]) == 1
    assert "299 recorded, 299 computed, 100 equal" in capsys.readouterr().out


def test_commands_of_another_count_are_another_controller_s(tmp_path: Path) -> None:
    log, config = runs.write_bench_log(tmp_path, runs.scenario("pi"))
    on_the_bus(log)
    foreign = CODEC.encode(CurrentCommand(12.0), 77).data.hex().upper()
    lines = log.read_text(encoding="ascii").splitlines()
    places = [index for index, line in enumerate(lines) if " 110#" in line][40:60:4]
    for index in reversed(places):
        stamp = lines[index].split()[0]
        lines.insert(index, f"{stamp} vcan0 100#{foreign}")
    log.write_text("\n".join(lines) + "\n", encoding="ascii")
    prepared = prepare(log, load_config(config), None)
    classifier = FrameClassifier(CODEC)
    assert prepared.commands == 300
    assert sum(classifier.is_command(frame) for cycle in prepared.cycles() for frame in cycle.inbox) == len(places) == 5


def test_a_replay_receives_the_messages_that_the_daemon_receives() -> None:
    assert set(INPUTS) == {*session.RECEIVED, CurrentCommand}
