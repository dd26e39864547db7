"""`positioner explain`: what it says about a command is what the trace and the truth say."""

from __future__ import annotations

import csv
import json
from collections import Counter
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import pytest
import replay_helpers as runs

from positioner.bench.inprocess import run_in_process
from positioner.cli.main import main
from positioner.diagnostics.explanation import ActiveBound, active_bound
from positioner.diagnostics.explanation_text import counts_line
from positioner.laws.bounds import Bounds
from positioner.laws.law import Decision
from positioner.laws.move_reason import current_in
from positioner.runtime.trace import TraceWriter
from positioner.wire.messages import Mode, Motion

if TYPE_CHECKING:
    from pathlib import Path

    Output = pytest.CaptureFixture[str]

SETPOINTS_MM = (73.0, 87.0, 80.0)


@pytest.fixture(scope="module", params=["nmpc", "paper"])
def played(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Any], str]:
    """Return the folder of a bench's log, the rows of its trace, and the law's name."""
    folder = tmp_path_factory.mktemp(request.param)
    scenario = replace(runs.scenario(request.param, seconds=1.5), visits=2)
    run = run_in_process(scenario)
    run.recording.write_log(folder / "bus.log")
    (folder / "valve.toml").write_text(runs.text_of(scenario), encoding="utf-8")
    trace = TraceWriter(folder / "trace.csv")
    trace.cycle(run.cycles)
    trace.close()
    with (folder / "trace.csv").open(encoding="utf-8", newline="") as file:
        return folder, list(csv.DictReader(file)), request.param


def explain(folder: Path, *more: str) -> int:
    return main(["explain", str(folder / "bus.log"), "--config", str(folder / "valve.toml"), *more])


def bound_in(row: dict[str, str], direction: float) -> str:
    """Return the bound that the row's numbers meet."""
    current_ma, low_ma, high_ma = (float(row[name]) for name in ("current_ma", "current_low_ma", "current_high_ma"))
    if int(row["motion"]) != Motion.MOVE:
        return "at rest"
    least_ma, most_ma = (low_ma, high_ma) if direction > 0.0 else (high_ma, low_ma)
    if abs(current_ma - most_ma) <= 0.0005:
        return "current limit"
    if abs(current_ma - least_ma) <= 0.0005:
        return "breakaway current"
    limit = float(row["speed_high_m_per_s"] if direction > 0.0 else row["speed_low_m_per_s"])
    return "speed bound" if limit and float(row["velocity_m_per_s"]) / limit >= 0.95 else "none"


@pytest.mark.slow(short="test_commands_that_are_not_those_of_the_record_are_told")
def test_every_command_of_a_bench_is_explained_as_the_trace_has_it(
    played: tuple[Path, list[Any], str], capsys: Output
) -> None:
    folder, rows, law = played
    assert explain(folder, "--json") == 0
    told = json.loads(capsys.readouterr().out)
    moves, commands = told["moves"], told["commands"]
    assert len(commands) == len(rows)
    met = set()
    for command, row in zip(commands, rows, strict=True):
        assert command["control_time_s"] == pytest.approx(float(row["time_s"]), abs=1e-6)
        assert command["current_ma"] == pytest.approx(float(row["current_ma"]), abs=0.0006)
        assert Mode[command["mode"]] == int(row["mode"])
        assert Motion[command["motion"]] == int(row["motion"])
        assert command["fallback"].replace(",", ";") == row["fallback"]
        if command["move"] is None:
            continue
        move = moves[command["move"] - 1]
        direction = 1.0 if move["reason"]["aim_m"] >= move["origin_m"] else -1.0
        assert command["bound"] == bound_in(row, direction)
        met.add(command["bound"])
    begun = [row["reason"] for row in rows if row["reason"]]
    assert len(begun) == len(moves)
    for move, reason in zip(moves, begun, strict=True):
        assert f"breakaway {move['reason']['breakaway_ma']:.3f} mA" in reason
        assert f"error {move['reason']['error_m'] * 1e3:+.3f} mm" in reason
    if law == "nmpc":
        assert {"at rest", "current limit"} < met
        assert len(moves) >= 6


def test_a_move_lands_where_the_stem_was_when_the_next_one_began(
    played: tuple[Path, list[Any], str], capsys: Output
) -> None:
    folder, _, law = played
    explain(folder, "--json")
    moves = json.loads(capsys.readouterr().out)["moves"]
    rested = [(move["landed_m"], after["origin_m"]) for move, after in pairwise(moves) if move["landed_m"] is not None]
    for landed_m, origin_m in rested:
        assert landed_m == pytest.approx(origin_m, abs=2e-3)
    if law == "nmpc":
        assert len(rested) >= 4  # a move away goes on at once
        assert min(abs(landed_m - 0.087) for landed_m, _ in rested) < 0.5e-3


def test_the_command_at_an_instant_is_told_in_words(played: tuple[Path, list[Any], str], capsys: Output) -> None:
    folder, rows, law = played
    assert explain(folder, "--at", "0.5005") == 0
    text = capsys.readouterr().out
    assert f"{float(rows[500]['current_ma']):.3f} mA at 0.500000 s" in text
    assert "mode      ACTIVE\n" in text
    words = [line[10:] for line in text.splitlines() if line.startswith("bound ")]
    assert len(words) == 1
    assert words[0].count("none") <= 1
    assert not words[0].startswith("at rest")
    assert "setpoint  87.000 mm" in text
    if law == "nmpc":
        assert "begun at 0.500000 s" in text
        assert "landing   " in text


def test_the_table_of_moves_names_every_one_and_counts_all_commands(
    played: tuple[Path, list[Any], str], capsys: Output
) -> None:
    folder, rows, law = played
    assert explain(folder) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[1].startswith(f"{len(rows)} commands: ")
    begun_ma = [current_ma for row in rows if (current_ma := current_in(row["reason"])) is not None]
    assert len(begun_ma) >= (6 if law == "nmpc" else 0)
    assert [line.split()[-1] for line in lines[5:]] == [f"{current_ma:.3f}" for current_ma in begun_ma]


def test_what_is_believed_of_a_valve_that_differs_is_told_with_its_doubt(tmp_path: Path, capsys: Output) -> None:
    """The valve behind a lag that is not configured, which its moves measure."""
    lag = {"fill_time_constant_s": 0.05, "vent_time_constant_s": 0.05}
    scenario = replace(runs.scenario("nmpc", seconds=3.0), plant={"preset": "paper", "actuator": lag})
    run_in_process(scenario).recording.write_log(tmp_path / "bus.log")
    (tmp_path / "valve.toml").write_text(runs.text_of(scenario), encoding="utf-8")
    assert explain(tmp_path, "--json") == 0
    moves = json.loads(capsys.readouterr().out)["moves"]
    first, believed = moves[0]["reason"]["believed"], moves[-1]["reason"]["believed"]
    for name, true in (("spring_n_per_m", 52538.0), ("offset_n", 0.0), ("static_n", 1707.7), ("coulomb_n", 1423.0)):
        mean, sigma = believed[name]
        assert abs(mean - true) < 3.0 * sigma
    assert 0.0 < believed["ends_m"] < 0.6 * first["ends_m"]
    assert explain(tmp_path, "--at", "8.9") == 0
    told = capsys.readouterr().out
    sliding, sigma = believed["coulomb_n"]
    assert f"F_c {round(sliding)} ± {sigma:.0f} N; the move ends within ± {1e3 * believed['ends_m']:.2f} mm (σ)" in told
    assert "valve     does not move as configured: identify it again" in told


def test_a_log_of_which_nothing_can_be_explained_is_told_to_hold_no_commands() -> None:
    assert counts_line(Counter()) == "no commands"
    assert counts_line(Counter(rest=3, current=1)) == "4 commands: 3 rest, 1 current"


def test_an_instant_before_the_first_command_is_refused(played: tuple[Path, list[Any], str], capsys: Output) -> None:
    assert explain(played[0], "--at", "-1") == 2
    assert "no command until -1 s" in capsys.readouterr().err


def test_commands_that_are_not_those_of_the_record_are_told(
    played: tuple[Path, list[Any], str], tmp_path: Path, capsys: Output
) -> None:
    folder, _, law = played
    other = tmp_path / "other.toml"
    text = (folder / "valve.toml").read_text(encoding="utf-8")
    assert f'law = "{law}"' in text
    other.write_text(text.replace(f'law = "{law}"', 'law = "pi"'), encoding="utf-8")
    assert main(["explain", str(folder / "bus.log"), "--config", str(other)]) == 1
    assert "recorded commands differ from the explained ones" in capsys.readouterr().err


def decision(current_ma: float, motion: Motion = Motion.MOVE) -> Decision:
    return Decision(current_ma, Bounds(0.0, 0.5, 12.0, 20.0), motion)


@pytest.mark.parametrize(
    ("current_ma", "admitted_ma", "velocity_m_per_s", "direction", "bound"),
    [
        (20.0, 20.0, 0.1, 1.0, ActiveBound.CURRENT),
        (20.0, 20.0, 0.1, -1.0, ActiveBound.BREAKAWAY),
        (12.0, 12.0, 0.1, 1.0, ActiveBound.BREAKAWAY),
        (12.0, 12.0, 0.1, -1.0, ActiveBound.CURRENT),
        (16.0, 16.0, 0.49, 1.0, ActiveBound.SPEED),
        (16.0, 16.0, 0.3, 1.0, ActiveBound.NONE),
        (16.0, 15.0, 0.49, 1.0, ActiveBound.GUARD),
    ],
)
def test_the_bound_that_a_command_meets(
    current_ma: float, admitted_ma: float, velocity_m_per_s: float, direction: float, bound: ActiveBound
) -> None:
    assert active_bound(decision(current_ma), admitted_ma, velocity_m_per_s, direction) is bound


def test_a_stem_at_rest_meets_no_bound() -> None:
    assert active_bound(decision(20.0, Motion.REST), 20.0, 0.0, 1.0) is ActiveBound.REST
