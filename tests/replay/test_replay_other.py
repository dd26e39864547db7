"""Replay with another law or with other settings: the commands that they would have sent."""

from __future__ import annotations

import csv
from typing import TYPE_CHECKING

import pytest
import replay_helpers as runs

from positioner.cli.main import main

if TYPE_CHECKING:
    from pathlib import Path

    Output = pytest.CaptureFixture[str]


FALLS_BACK = """
from positioner.laws.bounds import Bounds
from positioner.laws.law import Decision


class FallsBack:
    def __init__(self, parts):
        pass

    def begin(self, measured_m):
        return 0

    def decide(self, memory, stem, observation, table):
        why = "" if memory % 2 else "no plan: the spring is balanced"
        return memory + 1, Decision(12.0, Bounds(-1.0, 1.0, 4.0, 20.0), fallback=why)
"""


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    return runs.write_bench_log(tmp_path_factory.mktemp("bench"), runs.scenario("pi", seconds=0.3))


def ask(bench: tuple[Path, Path], *more: str) -> int:
    log, config = bench
    return main(["replay", str(log), "--config", str(config), *more])


def test_the_same_law_would_have_done_the_same(bench: tuple[Path, Path], capsys: Output) -> None:
    assert ask(bench, "--law", "pi") == 0
    output = capsys.readouterr().out.splitlines()
    assert output[1:] == [
        "commands: 300 in both, 0 recorded only, 0 computed only",
        "no difference: every current is as recorded",
        "modes: ACTIVE 0.299 s",
        "fallbacks: 0",
    ]


def test_a_law_that_uses_its_own_current_would_have_done_the_same_too(tmp_path: Path, capsys: Output) -> None:
    # a frame rounds the current that the law computed: an equal frame leaves the unrounded current in the state
    assert ask(runs.write_bench_log(tmp_path, runs.scenario("nmpc", seconds=0.6)), "--law", "nmpc") == 0
    assert "no difference: every current is as recorded" in capsys.readouterr().out


def test_another_law_is_summed_up_and_drawn(bench: tuple[Path, Path], tmp_path: Path, capsys: Output) -> None:
    assert ask(bench, "--law", "paper", "--out", str(tmp_path / "out")) == 0
    captured = capsys.readouterr()
    output = captured.out.splitlines()
    assert output[1] == "commands: 300 in both, 0 recorded only, 0 computed only"
    with (tmp_path / "out" / "trace.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 300
    apart = [abs(float(row["recorded_ma"]) - float(row["computed_ma"])) for row in rows]
    mean_ma, largest_ma = sum(apart) / len(apart), max(apart)
    assert 0.05 < mean_ma < largest_ma < 16.0
    assert output[2].startswith(f"difference of current: mean {mean_ma:.3f} mA, largest {largest_ma:.3f} mA at ")
    first, gap_ma = next((row, gap_ma) for row, gap_ma in zip(rows, apart, strict=True) if gap_ma > 0.0005)
    assert output[3] == (
        f"first difference: {gap_ma:.3f} mA at {float(first['time_s']):.3f} s "
        f"({float(first['recorded_ma']):.3f} mA recorded, {float(first['computed_ma']):.3f} mA computed)"
    )
    picture = (tmp_path / "out" / "replay.png").read_bytes()
    assert picture.startswith(b"\x89PNG\r\n")
    assert len(picture) > 20_000
    assert captured.err.endswith(f"{tmp_path / 'out'}: trace.csv, replay.png and .svg\n")


def test_other_settings_are_asked_the_same_way(bench: tuple[Path, Path], capsys: Output) -> None:
    assert ask(bench, "--set", "guard.current_high_ma=15") == 0
    output = capsys.readouterr().out
    assert "(20.000 mA recorded, 15.000 mA computed)" in output


def test_a_law_that_falls_back_is_reported_with_its_reasons(
    bench: tuple[Path, Path], tmp_path: Path, capsys: Output
) -> None:
    law = tmp_path / "law.py"
    law.write_text(FALLS_BACK, encoding="utf-8")
    assert ask(bench, "--law", f"{law}:FallsBack") == 0
    output = capsys.readouterr().out.splitlines()
    total = next(int(line.split()[1]) for line in output if line.startswith("fallbacks: "))
    reasons = [line for line in output if line.startswith("  ")]
    assert total == 150
    assert len(reasons) == 1
    assert "no plan: the spring is balanced" in reasons[0]


def test_the_other_law_sees_the_current_that_moved_the_valve(bench: tuple[Path, Path], tmp_path: Path) -> None:
    # at most one move away from the record: the law's own command never reaches the valve, nor its rate limit
    assert ask(bench, "--set", "guard.max_rate_ma_per_s=100", "--out", str(tmp_path)) == 0
    with (tmp_path / "trace.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    before_ma = [float(row["recorded_ma"]) for row in rows[:-1]]
    steps_ma = [abs(float(row["computed_ma"]) - last_ma) for row, last_ma in zip(rows[1:], before_ma, strict=True)]
    assert max(steps_ma) == pytest.approx(0.1, abs=0.001)


def test_a_folder_that_cannot_be_written_is_reported(bench: tuple[Path, Path], capsys: Output) -> None:
    assert ask(bench, "--law", "paper", "--out", "/dev/null/x") == 74
    assert capsys.readouterr().err == "positioner: /dev/null/x: cannot be written: Not a directory\n"
