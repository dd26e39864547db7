"""A name that is none: the same exit status for all of them on a command line, and the nearest that there is."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from plant_emulator.cli import main as plant
from positioner.cli import main as positioner
from positioner.errors import ExitCode, UsageError
from positioner.inputs.nearest import names_in, nearest

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

TYPOS: list[tuple[Callable[[list[str]], int], str, str]] = [
    (positioner.main, "benhc", "bench"),
    (positioner.main, "table dmup", "dump"),
    (positioner.main, "bench --law nmcp", "nmpc"),
    (positioner.main, "bench --scenario papr-valve", "paper-valve"),
    (positioner.main, "bench --clock relatime", "realtime"),
    (positioner.main, "league --laws nmpc,papr", "paper"),
    (positioner.main, "league --plants spring-02", "spring-20"),
    (positioner.main, "bench --plant grahpite", "graphite"),
    (positioner.main, "replay x.log --config x.toml --law knoker", "knocker"),
    (positioner.main, "tune two-mov", "two-move"),
    (positioner.main, "reproduce --reading bot", "both"),
    (plant.main, "simulat", "simulate"),
    (plant.main, "run --preset grahpite", "graphite"),
    (plant.main, "simulate --preset stocastic", "stochastic"),
    (plant.main, "simulate --input trianlge", "triangle"),
]


@pytest.mark.parametrize(("program", "line", "meant"), TYPOS, ids=[line for _, line, _ in TYPOS])
def test_a_typo_is_a_wrong_command_line_and_is_reported_with_the_nearest_name(
    program: Callable[[list[str]], int],
    line: str,
    meant: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    try:
        status: Any = program(line.split())
    except SystemExit as ended:  # argparse's own way
        status = ended.code
    assert status == ExitCode.USAGE
    last = capsys.readouterr().err.splitlines()[-1]
    assert f" is unknown; did you mean {meant!r}? known: " in last
    assert list(tmp_path.iterdir()) == []


def test_what_resembles_nothing_gets_the_list_alone() -> None:
    assert nearest("zzz", ("one", "two")) == "known: one, two"


def test_a_list_of_names_may_have_blanks_and_repetitions() -> None:
    assert names_in("law", "pi, nmpc ,pi", ("nmpc", "pi")) == ("pi", "nmpc")
    with pytest.raises(UsageError, match="law '' is unknown"):
        names_in("law", "pi,", ("pi",))
