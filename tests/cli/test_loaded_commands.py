"""What a command line loads: the modules of its command and no others."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from positioner.cli.main import build_parser
from positioner.machine.commands import words_given

if TYPE_CHECKING:
    from pathlib import Path

HEAVY = ("numpy", "can", "cantools", "pydantic", "osqp", "matplotlib")
LOADED = """
import sys
from positioner.start import load
try:
    load(sys.argv[0], sys.argv.pop(1))
except SystemExit:
    pass
print(*sys.modules)
"""


def loaded(*arguments: str, module: str = "positioner.cli.main") -> set[str]:
    """Return the modules that a program has loaded when it ends."""
    command = [sys.executable, "-c", LOADED, module, *arguments]
    out = subprocess.run(command, check=True, capture_output=True, text=True, timeout=60.0).stdout
    return set(out.splitlines()[-1].split())


@pytest.mark.parametrize("module", ["positioner.cli.main", "plant_emulator.cli.main"])
def test_the_version_needs_no_command(module: str) -> None:
    modules = loaded("--version", module=module)
    assert not modules & set(HEAVY)
    assert {name for name in modules if name.startswith(("positioner.cli.", "plant_emulator.cli."))} == {module}


def test_a_command_loads_itself_alone() -> None:
    modules = loaded("reproduce", "--help")
    assert "positioner.cli.reproduce" in modules
    assert "positioner.cli.bench" not in modules
    assert not modules & {"numpy", "can"}


def test_a_mistake_and_the_help_know_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert "control an emulated valve" in build_parser(words_given(["--help"])).format_help()
    with pytest.raises(SystemExit):
        build_parser(words_given(["bnech"])).parse_args(["bnech"])
    assert "did you mean 'bench'" in capsys.readouterr().err


def test_a_shell_completes_from_the_line_as_typed(tmp_path: Path) -> None:
    line = "positioner table re"
    answer = tmp_path / "answer"
    environment = {
        **os.environ,
        "COMP_LINE": line,
        "COMP_POINT": str(len(line)),
        "_ARGCOMPLETE": "1",
        "_ARGCOMPLETE_STDOUT_FILENAME": str(answer),
    }
    subprocess.run([sys.executable, "-m", "positioner"], env=environment, check=True, timeout=60.0)
    assert answer.read_text("utf-8").strip() == "reset"
