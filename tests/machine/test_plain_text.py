"""A terminal that knows ASCII alone gets everything in other words, and never a traceback."""

from __future__ import annotations

import io
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from test_cli import PARSERS

from plant_emulator.cli import main as plant
from positioner.cli import main as positioner
from positioner.errors import ExitCode
from positioner.machine.plain_text import replace_unknown_characters, to_ascii

ROOT = Path(__file__).resolve().parents[2]
ASCII = {"LC_ALL": "C", "LANG": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0", "PYTHONIOENCODING": "ascii"}
SHORT = 'name = "s"\ntitle = "of α to ω"\nlaw = "pi"\nsetpoints_mm = [73.0]\ndwell_s = 0.02\n'


def run(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run `positioner` on a terminal of the last century."""
    environment = {**os.environ, **ASCII, "PYTHONPATH": str(ROOT)}
    return subprocess.run(
        [sys.executable, "-m", "positioner", *arguments],
        env=environment, cwd=cwd, capture_output=True, encoding="ascii", check=False, timeout=120.0,
    )  # fmt: skip


@pytest.mark.parametrize("prog", PARSERS)
def test_every_help_is_shown_on_an_ascii_terminal(prog: str, monkeypatch: pytest.MonkeyPatch) -> None:
    shown = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(shown, encoding="ascii", errors="strict", write_through=True))
    program: Any = positioner if prog.startswith("positioner") else plant
    with pytest.raises(SystemExit) as ended:
        program.main([*prog.split()[1:], "--help"])
    assert ended.value.code == ExitCode.OK
    assert shown.getvalue().decode("ascii").startswith(f"usage: {prog}")


@pytest.mark.bus
def test_a_bench_and_a_table_are_shown_in_ascii_throughout(tmp_path: Path) -> None:
    (tmp_path / "s.toml").write_text(SHORT, encoding="utf-8")
    done = run("bench", "--scenario", "./s.toml", "--out", "out", cwd=tmp_path)
    assert done.returncode == ExitCode.OK, done.stderr
    assert done.stdout.startswith("s: of alpha to omega\n")
    assert "\n---" in done.stdout
    assert " samples, 0 -> " in done.stdout
    done = run("table", "dump", "--config", "out/valve.toml", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (ExitCode.OK, "")


@pytest.mark.bus
@pytest.mark.parametrize(
    ("arguments", "status"),
    [
        (["check", "--example"], ExitCode.OK),
        (["check", "ungültig-α.toml"], ExitCode.CONFIG),
        (["bench", "--scenario", "α"], ExitCode.USAGE),
        (["bench", "--law", "α"], ExitCode.USAGE),
        (["reproduce", "--help"], ExitCode.OK),
    ],
)
def test_nothing_that_is_typed_ends_in_a_traceback(arguments: list[str], status: ExitCode, tmp_path: Path) -> None:
    environment = {**os.environ, **ASCII, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-m", "positioner", *arguments],
        env=environment, cwd=tmp_path, capture_output=True, check=False, timeout=120.0,
    )  # fmt: skip
    assert done.returncode == status, done.stderr
    assert b"Traceback" not in done.stderr


@given(st.text())
def test_whatever_the_text_an_ascii_stream_takes_it(text: str) -> None:
    shown = io.BytesIO()
    stream = io.TextIOWrapper(shown, encoding="ascii", errors="strict", write_through=True, newline="")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "stdout", stream)
        replace_unknown_characters()
    stream.write(text)
    assert shown.getvalue().decode("ascii") == to_ascii(text)


def test_characters_are_written_in_ascii_and_the_rest_as_question_marks() -> None:
    assert to_ascii("±0.3 mm², α ≤ 5 → Γ…") == "+-0.3 mm^2, alpha <= 5 -> Gamma..."
    assert to_ascii("日本") == "??"
