"""`positioner diagnose` as a user calls it: text, JSON, picture, exit status, and one line for each mistake."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np
import pytest
from emulated_loops import Kind, Loop, play

from positioner.cli.main import main

if TYPE_CHECKING:
    from pathlib import Path

STICK, JUMP = 9.0, 3.0


@pytest.fixture(scope="module")
def sticking(tmp_path_factory: pytest.TempPathFactory) -> Path:
    played = play(Loop(Kind.STICKING, STICK, JUMP, 12))
    path = tmp_path_factory.mktemp("loops") / "sticking.csv"
    table = np.column_stack([np.arange(played.op.size) * 2.0, played.op, played.pv, played.sp, played.stem])
    np.savetxt(path, table, delimiter=",", header="time,OP,PV,SP,MV", comments="", fmt="%.5f")
    return path


def test_the_verdict_comes_first_and_the_exit_status_tells_it(
    sticking: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["diagnose", str(sticking)]) == 1
    text = capsys.readouterr().out
    assert text.startswith(f"{sticking}: the valve sticks: ")
    for name in ("HAMM", "ADD", "YAM", "CORR", "CURVE", "RELAY", "AREA", "BIC"):
        assert f"\n{name} " in text


def test_the_report_has_the_verdict_the_signals_and_each_method(
    sticking: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "loop.html"
    assert main(["diagnose", str(sticking), "--report", str(page)]) == 1
    said = capsys.readouterr()
    assert said.err == f"report: {page}\n"
    text = page.read_text(encoding="utf-8")
    assert "<h2>Maintenance required</h2>" in text
    assert "The valve sticks: " in text
    assert text.count("<svg") >= 3
    assert text.count('class="dot"') > 5, "each slip"
    for name in ("HAMM", "ADD", "YAM", "CORR", "CURVE", "RELAY", "AREA", "BIC"):
        assert f">{name}<" in text
    assert "S, stick and dead band" in text
    assert len(text) < 200_000
    assert main(["diagnose", str(sticking), "--report", str(tmp_path / "nowhere" / "loop.html")]) == 74
    assert "cannot be written" in capsys.readouterr().err


def test_json_has_both_diagnoses_with_intervals(sticking: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["diagnose", str(sticking), "--json"]) == 1
    found = json.loads(capsys.readouterr().out)
    assert (found["verdict"], found["method"], found["period_s"]) == ("yes", "direct", 2.0)
    assert found["stick_percent"]["low"] <= STICK <= found["stick_percent"]["high"]
    assert found["jump_percent"]["value"] == pytest.approx(JUMP, abs=0.5)
    assert {each["name"] for each in found["indirect"]["methods"]} >= {"HAMM", "BIC"}


def test_a_range_of_op_in_ma_gives_the_same_percentages(
    sticking: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = np.loadtxt(sticking, delimiter=",", skiprows=1)
    table[:, 1] = 4.0 + 0.16 * table[:, 1]
    path = tmp_path / "ma.csv"
    np.savetxt(path, table, delimiter=";", header="time;current_ma;flow;SP;stem", comments="")
    arguments = ["diagnose", str(path), "--op-range", "4,20", "--pv", "flow", "--json"]
    assert main(arguments) == 1
    found = json.loads(capsys.readouterr().out)
    assert found["stick_percent"]["value"] == pytest.approx(STICK, rel=0.05)


def test_the_picture_is_drawn(sticking: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    picture = tmp_path / "loop.png"
    assert main(["diagnose", str(sticking), "--picture", str(picture)]) == 1
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert capsys.readouterr().err == f"picture: {picture}\n"


def test_a_loop_at_rest_is_undecided_and_the_line_says_what_is_needed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    played = play(Loop(Kind.HEALTHY, 0.1, 0.0, 21))
    scale = 0.33 / float(np.quantile(played.op, 0.995) - np.quantile(played.op, 0.005))
    path = tmp_path / "rest.csv"
    table = np.column_stack([np.arange(played.op.size), 50.0 + scale * (played.op - 50.0), scale * played.pv])
    np.savetxt(path, table, delimiter=",", header="time,OP,PV", comments="", fmt="%.6f")
    assert main(["diagnose", str(path)]) == 0
    text = capsys.readouterr().out
    assert text.startswith(f"{path}: undecided: OP moved by 0.33 % only")
    assert "a record is needed in which OP moves by more than 1.4 % and back, as after setpoint steps" in text
    assert "no stiction is not healthy" not in text
    assert main(["diagnose", str(path), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["verdict"], found["indirect"]["verdict"]) == ("undecided", "undecided")
    assert found["op_moved_percent"] == pytest.approx(0.33, abs=0.001)


@pytest.mark.parametrize(
    ("content", "options", "status", "message"),
    [
        (None, (), 74, "cannot be read: No such file or directory"),
        ("OP,PV\n1,2\n3,4\n", (), 74, "holds 2 samples without a gap, and at least 200 are needed"),
        ("OP,PV\n1,2\n3,4\n", ("--op", "XX"), 2, "has no column 'XX' (--op)"),
        ("OP,PV\n1,2\n3,4\n", ("--op-range", "4"), 2, "--op-range '4': give OP at 0 and at 100 %, like 4,20"),
        ("OP,PV\n1,2\n3,4\n", ("--period", "0"), 2, "--period 0 is no period: give seconds above 0"),
    ],
)
def test_a_mistake_gets_one_line(
    content: str | None,
    options: tuple[str, ...],
    status: int,
    message: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = tmp_path / "loop.csv"
    if content is not None:
        path.write_text(content, encoding="utf-8")
    assert main(["diagnose", str(path), *options]) == status
    (line,) = capsys.readouterr().err.splitlines()
    assert message in line
