"""Replay with a law in the shadow: where it would have done otherwise, dwell by dwell."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
import replay_helpers as runs

from positioner.cli.main import main
from positioner.config.reader import load_config
from positioner.replay.prepare import prepare
from positioner.replay.recorded import command_in
from positioner.replay.run import replay_cycles
from positioner.replay.shadow import ReplayedShadow

if TYPE_CHECKING:
    Output = pytest.CaptureFixture[str]

LOGS = Path(__file__).parents[1] / "logs"
STORED = (LOGS / "nmpc.log.gz", LOGS / "nmpc.toml")
FAULTS = (LOGS / "faults.log.gz", LOGS / "faults.toml")
LAWS_IN_A_FILE = """
from positioner.laws.registry import make_law


def same(parts, factor=1.0):
    return make_law({law!r}, parts)


class Raises:
    def __init__(self, parts):
        pass

    def begin(self, measured_m):
        return 0

    def decide(self, memory, stem, observation, table):
        return memory + 1, 12.0 if memory < 100 else 1 / 0
"""


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    return runs.write_bench_log(tmp_path_factory.mktemp("bench"), runs.scenario("nmpc", seconds=0.9))


@pytest.fixture
def laws(tmp_path: Path) -> Path:
    """A file with the law of the stored logs under another name, and with a law that raises."""
    path = tmp_path / "laws.py"
    path.write_text(LAWS_IN_A_FILE.format(law="nmpc"), encoding="utf-8")
    return path


def ask(log: tuple[Path, Path], *more: str) -> int:
    return main(["replay", str(log[0]), "--config", str(log[1]), *more])


def told(capsys: Output, log: tuple[Path, Path], shadow: str, *more: str) -> dict[str, Any]:
    assert ask(log, "--shadow", shadow, "--json", *more) == 0
    document: dict[str, Any] = json.loads(capsys.readouterr().out)
    return document


def commands_of(log: tuple[Path, Path], law: str, folder: Path) -> list[tuple[float, float, str]]:
    """Return what a law alone would have commanded, by `--law`: setpoint in m, current in mA, reason of a move."""
    assert ask(log, "--law", law, "--out", str(folder)) == 0
    with (folder / "trace.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    return [(float(row["setpoint_m"]), float(row["computed_ma"]), row["reason"]) for row in rows]


@pytest.mark.parametrize("shadow", ["pi", "paper", "paper-plain"])
def test_the_differences_are_those_of_two_recordings(
    bench: tuple[Path, Path], shadow: str, tmp_path: Path, capsys: Output
) -> None:
    acting, other = (commands_of(bench, law, tmp_path / law) for law in ("nmpc", shadow))
    capsys.readouterr()
    found = told(capsys, bench, shadow)
    assert [dwell["setpoint_m"] for dwell in found["dwells"]] == pytest.approx([0.073, 0.087, 0.08])
    for dwell in (*found["dwells"], found["total"]):
        both = [
            (own, its)
            for number, (own, its) in enumerate(zip(acting, other, strict=True))
            if dwell["begin_s"] - 1e-6 < 0.001 * number < dwell["end_s"] + 1e-6
        ]
        apart_ma = [its[1] - own[1] for own, its in both]  # rounded to the bits of a frame, 0.001 mA
        assert dwell["cycles"] == len(both) > 200
        assert dwell["mean_difference_ma"] == pytest.approx(sum(map(abs, apart_ma)) / len(both), abs=0.001)
        assert dwell["largest_difference_ma"] == pytest.approx(max(apart_ma, key=abs), abs=0.0011)
        near = sum(abs(abs(gap_ma) - 0.1) < 0.0011 for gap_ma in apart_ma)
        above = sum(abs(gap_ma) > 0.1 for gap_ma in apart_ma)
        assert dwell["share_apart"] * len(both) == pytest.approx(above, abs=near + 1e-6)
        assert (dwell["moves"], dwell["shadow_moves"]) == tuple(
            sum(bool(pair[law][2]) for pair in both) for law in (0, 1)
        )
    own_moves = [0.001 * at for at, (own, its) in enumerate(zip(acting, other, strict=True)) if its[2] and not own[2]]
    assert found["total"]["own_move_s"] == (pytest.approx(own_moves[0]) if own_moves else None)
    assert found["total"]["cycles"] == 900


@pytest.mark.parametrize("log", [STORED, FAULTS], ids=["nmpc", "faults"])
def test_the_law_of_a_log_as_its_own_shadow_does_the_same_through_every_restart(
    log: tuple[Path, Path], laws: Path, capsys: Output
) -> None:
    found = told(capsys, log, f"{laws}:same")
    total = found["total"]
    assert (total["largest_difference_ma"], total["share_apart"], total["own_move_s"]) == (0.0, 0.0, None)
    assert total["moves"] == total["shadow_moves"] > 2
    assert total["cycles"] > 1000
    assert found["recorded"]["first_difference"] is None


def test_a_table_shows_each_dwell_and_all_of_them(capsys: Output) -> None:
    assert ask(STORED, "--shadow", "pi") == 0
    captured = capsys.readouterr()
    lines = captured.out.splitlines()
    rows = [line.split() for line in lines if line.split()[:1] and line.split()[0] in {"1", "2", "3", "4", "all"}]
    assert [row[:5] for row in rows[:-1]] == [
        [str(number), f"{number - 1}.000", "0.999", f"{setpoint_mm}.000", "1000"]
        for number, setpoint_mm in enumerate((73, 87, 80), 1)
    ]
    assert rows[-1][:4] == ["all", "0.000", "2.999", "3000"]
    assert lines[-1].startswith("shadow pi beside nmpc: 3000 commands, began 0 moves where the acting law began ")
    assert captured.err == ""


def test_a_setpoint_that_is_passed_on_the_way_is_no_dwell(bench: tuple[Path, Path], capsys: Output) -> None:
    # of the 0.3 s at 87 mm the way there from 73 mm, 14 of 127 mm, takes 0.02 s: some twenty setpoints
    found = told(capsys, bench, "pi", "--set", "setpoint.opening_per_s=5", "--set", "setpoint.closing_per_s=5")
    assert [dwell["setpoint_m"] for dwell in found["dwells"]] == pytest.approx([0.073, 0.087, 0.08])
    assert sum(dwell["cycles"] for dwell in found["dwells"]) == found["total"]["cycles"] == 900


def test_quasi_static_moves_in_the_shadow_know_what_was_sent_and_begin_again_at_each_setpoint() -> None:
    configuration = load_config(STORED[1], {"control": {"law": "paper", "shadow": "quasi-static"}})
    prepared, setup, law = (
        prepare(STORED[0], configuration, None),
        configuration.make_setup(),
        configuration.make_shadow(),
    )
    assert law is not None
    shadow = ReplayedShadow(setup, law)
    cycles = replay_cycles(configuration, prepared.cycles(), prepared.table, follows=True, setup=setup, shadow=shadow)
    for cycle in cycles:
        state, sent = shadow._law._state, command_in(setup.codec, [each.frame for each in cycle.recorded.outbox])
        assert state is not None
        assert sent is not None
        assert state.control.memory.sent_ma == pytest.approx(sent[0].current_ma, abs=0.0006)
    moves = [dwell["shadow_moves"] for dwell in shadow.as_json()["dwells"]]
    assert len(moves) == 3
    assert all(moves)


def test_a_shadow_that_raises_is_told_with_what_was_compared_before(laws: Path, capsys: Output) -> None:
    assert ask(STORED, "--shadow", f"{laws}:Raises") == 1
    output = capsys.readouterr().out
    assert "shadow laws.py:Raises beside nmpc was dropped at 0.100 s: laws.py:Raises failed: " in output
    assert "ZeroDivisionError: division by zero (laws.py, line " in output
    assert "shadow laws.py:Raises beside nmpc: 100 commands" in output


def test_a_log_that_starts_late_shows_differences_too(tmp_path: Path, capsys: Output) -> None:
    log, config = runs.write_bench_log(tmp_path, runs.scenario("pi", seconds=0.6))
    log.write_text("".join(log.read_text(encoding="ascii").splitlines(keepends=True)[700:]), encoding="ascii")
    assert ask((log, config), "--law", "pi") == 0
    capsys.readouterr()
    assert ask((log, config), "--shadow", "paper") == 0
    captured = capsys.readouterr()
    assert "starts late" in captured.out
    assert "shadow paper beside pi: " in captured.out
    # its integral is another one than that of the law that was recorded
    assert captured.err == (
        "pi, which the shadow is compared with, commands otherwise than it was recorded; replay without --shadow shows "
        "where\n"
    )


@pytest.mark.parametrize(
    ("more", "status", "line"),
    [
        (("--shadow", "pie"), 2, "positioner: --shadow pie: is unknown; did you mean "),
        (("--shadow", "nmpc"), 78, "control.shadow = 'nmpc': is the law that controls the valve; a shadow is another"),
        (("--shadow", "pi", "--out", "folder"), 2, "positioner: --out goes without --shadow: "),
    ],
)
def test_what_cannot_be_compared_is_refused_in_one_line(
    more: tuple[str, ...], status: int, line: str, capsys: Output
) -> None:
    assert ask(STORED, *more) == status
    error = capsys.readouterr().err
    assert line in error
    assert error.count("\n") == 1


def test_another_law_or_a_shadow_is_asked_for_not_both(capsys: Output) -> None:
    with pytest.raises(SystemExit) as ended:
        ask(STORED, "--shadow", "pi", "--law", "paper")
    assert ended.value.code == 2
    assert "not allowed with argument --shadow" in capsys.readouterr().err


def test_a_configured_shadow_does_not_hinder_the_replay_of_its_law(
    bench: tuple[Path, Path], tmp_path: Path, capsys: Output
) -> None:
    config = tmp_path / "valve.toml"
    config.write_text(bench[1].read_text(encoding="utf-8").replace("[control]\n", '[control]\nshadow = "pi"\n', 1))
    assert ask((bench[0], config)) == 0
    assert ask((bench[0], config), "--law", "pi") == 0
    assert "mA recorded" in capsys.readouterr().out
