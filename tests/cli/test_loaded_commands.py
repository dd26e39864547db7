"""What a command line loads: the modules of its command and no others."""

from __future__ import annotations

import subprocess
import sys

import pytest

from positioner.cli.main import build_parser
from positioner.machine.commands import words_given

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
    out = subprocess.run(command, check=True, capture_output=True, text=True, timeout=300.0).stdout
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


@pytest.mark.parametrize("arguments", [("run", "--help"), ("league", "--help"), ("check", "--example")])
def test_what_draws_tables_is_not_loaded_before_a_table_is_shown(arguments: tuple[str, ...]) -> None:
    assert "rich" not in loaded(*arguments)


def test_a_mistake_and_the_help_know_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert "control an emulated valve" in build_parser(words_given(["--help"])).format_help()
    with pytest.raises(SystemExit):
        build_parser(words_given(["bnech"])).parse_args(["bnech"])
    assert "did you mean 'bench'" in capsys.readouterr().err
