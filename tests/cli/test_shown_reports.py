"""Reports of commands in terminals of 80 and 120 columns and in a pipe: no figure is cut, and nothing is too wide."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING

import pytest
from host_in_terminal import InTerminal
from report_samples import SIGNATURE, row, signature
from screens import screen, shown

from positioner.cli.main import main
from positioner.commissioning.step.report import SIZE_HEAD
from positioner.errors import ExitCode
from positioner.report.quantities import quantity_table
from positioner.report.table import Table

if TYPE_CHECKING:
    from pathlib import Path

    from positioner.report.text import Block

STEPS = Table.of(
    SIZE_HEAD, [(f"{size} up", "3/3", "C", *("12.3 (10.2–14.5)",) * 5, "1.00 (0.99–1.01)") for size in (2, 10)]
)
BLOCKS: dict[str, Block] = {
    "signature": quantity_table(signature(1.27)["rows"], SIGNATURE["rows"]),
    "identify": quantity_table([*SIGNATURE["rows"], {**row("Stribeck velocity", "mm/s", 0.254), "seen": False}]),
    "step-test": STEPS,
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A configuration, and a loop that oscillates."""
    path = tmp_path_factory.mktemp("reports")
    (path / "valve.toml").write_text('[valve]\nid = "FV-101"\npreset = "paper"\n', encoding="utf-8")
    rows = (f"{50.0 + 9.0 * math.sin(at / 9.0):.3f},{40.0 - 5.0 * math.cos(at / 9.0):.3f}" for at in range(600))
    (path / "loop.csv").write_text("\n".join(["OP,PV", *rows]) + "\n", encoding="utf-8")
    return path


def arguments_of(name: str, folder: Path) -> list[str]:
    valve = str(folder / "valve.toml")
    return {
        "check": ["check", valve],
        "reach": ["reach", "--config", valve],
        "diagnose": ["diagnose", str(folder / "loop.csv")],
    }[name]


def figures(text: str) -> list[str]:
    """Return the words with a digit, without the path of the test's folder."""
    return sorted(word for word in text.split() if re.search(r"\d", word) and "/" not in word)


@pytest.mark.parametrize("name", ["check", "reach", "diagnose"])
def test_a_command_shows_in_any_terminal_the_figures_of_the_pipe(name: str, folder: Path) -> None:
    arguments = arguments_of(name, folder)
    with screen(None) as piped:
        assert main(arguments) == ExitCode.OK
    assert figures(piped.text)
    for width in (80, 120):
        with screen(width) as terminal:
            main(arguments)
        assert max(map(len, terminal.text.splitlines())) <= width
        assert set(figures(piped.text)) <= set(figures(terminal.text))
    with screen(None) as document:
        main([*arguments, "--markdown"])
    assert "| --- |" in document.text


@pytest.mark.parametrize("width", [80, 120])
@pytest.mark.parametrize("name", BLOCKS)
def test_a_result_fits_with_every_figure_whole(name: str, width: int) -> None:
    piped, terminal = shown([BLOCKS[name]]), shown([BLOCKS[name]], width)
    assert max(len(re.sub(r"\x1b[^m]*m", "", line)) for line in terminal.splitlines()) <= width
    assert set(figures(piped)) <= set(figures(re.sub(r"\x1b[^m]*m", "", terminal)))


@pytest.mark.bus
@pytest.mark.parametrize(
    ("width", "environment"), [(80, {}), (120, {"NO_COLOR": "1"}), (80, {"TERM": "dumb"}), (120, {"LC_ALL": "C"})]
)
def test_a_report_in_a_real_terminal(width: int, environment: dict[str, str], folder: Path) -> None:
    program = ("-m", "positioner", *arguments_of("reach", folder))
    with InTerminal(program=program, size=(width, 60), environment=environment) as it:
        assert it.ended() == ExitCode.OK
        shows = it.text
    with screen(None) as piped:
        main(arguments_of("reach", folder))
    assert not set(figures(piped.text)) - set(figures(shows))
    assert (b"\x1b" in it.received) is ("TERM" not in environment)
    assert re.search(rb"\x1b\[3\d", it.received) is None, "bold alone"
    assert it.received.isascii() is ("TERM" in environment or "LC_ALL" in environment)
