"""What nobody has foreseen ends in one line and a documented status, and in a traceback for who asks for it."""

from __future__ import annotations

import builtins
import errno
import os
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from plant_emulator import start as plant_start
from positioner import start
from positioner.cli.main import main
from positioner.errors import ExitCode

if TYPE_CHECKING:
    Output = pytest.CaptureFixture[str]

ERRORS: list[tuple[BaseException, ExitCode, str]] = [
    (OSError(errno.EMFILE, "Too many open files"), ExitCode.SYSTEM, "the system refuses: OSError: [Errno 24] Too many"),
    (MemoryError(), ExitCode.SYSTEM, "the system refuses: MemoryError: without a text"),
    (
        ImportError("libopenblas.so:\n cannot allocate memory"),
        ExitCode.SYSTEM,
        "libopenblas.so: cannot allocate memory",
    ),
    (KeyError("x"), ExitCode.SOFTWARE, "internal error: KeyError: 'x' in "),
]


@pytest.fixture(autouse=True)
def _no_traceback(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(start.TRACEBACK, raising=False)


@pytest.mark.parametrize(("error", "status", "expected"), ERRORS)
def test_a_command_that_fails_unexpectedly_ends_in_one_line(
    error: BaseException, status: ExitCode, expected: str, monkeypatch: pytest.MonkeyPatch, capsys: Output
) -> None:
    def fails() -> str:
        raise error

    monkeypatch.setattr("positioner.cli.check.example_text", fails)
    assert main(["check", "--example"]) == status
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("positioner: ")
    assert expected in line
    monkeypatch.setenv(start.TRACEBACK, "1")
    with pytest.raises(type(error)):
        main(["check", "--example"])


@pytest.mark.parametrize(("program", "name"), [(start, "positioner"), (plant_start, "plant-emulator")])
@pytest.mark.parametrize(
    ("error", "status", "expected"), [*ERRORS, (BaseException("a panic"), ExitCode.SOFTWARE, "a panic")]
)
def test_a_program_that_cannot_be_loaded_ends_in_one_line(
    error: BaseException,
    status: ExitCode,
    expected: str,
    program: Any,
    name: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: Output,
) -> None:
    real = builtins.__import__

    def fails(module: str, *more: Any, **named: Any) -> Any:
        if module.endswith(".cli.main"):
            raise error
        return real(module, *more, **named)

    monkeypatch.setattr(builtins, "__import__", fails)
    assert program.main() == status
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"{name}: cannot be loaded: ")
    assert expected in line
    monkeypatch.setenv(start.TRACEBACK, "1")
    with pytest.raises(type(error)):
        program.main()


@pytest.mark.parametrize("program", [start, plant_start])
def test_ctrl_c_while_a_program_is_loaded_ends_it_without_a_traceback(
    program: Any, monkeypatch: pytest.MonkeyPatch, capsys: Output
) -> None:
    def interrupted(*_arguments: object, **_named: object) -> Any:
        raise KeyboardInterrupt

    monkeypatch.setattr(builtins, "__import__", interrupted)
    status = program.main()
    monkeypatch.undo()
    assert status == 130
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("number", [errno.EIO, errno.EMFILE, errno.ENOMEM])
def test_a_file_that_the_system_refuses_for_now_is_no_mistake_of_the_configuration(
    number: int, monkeypatch: pytest.MonkeyPatch, capsys: Output, tmp_path: Path
) -> None:
    def refused(path: Path, *_arguments: object, **_more: object) -> str:
        raise OSError(number, os.strerror(number), str(path))

    monkeypatch.setattr(Path, "open", refused)
    assert main(["check", str(tmp_path / "valve.toml")]) == ExitCode.SYSTEM
    assert os.strerror(number) in capsys.readouterr().err


def test_a_load_error_is_reported_with_loaded_modules_only() -> None:
    code = "import sys; before = set(sys.modules); import NAME; print(*(set(sys.modules) - before))"
    for program in ("positioner", "plant_emulator"):
        named = code.replace("NAME", f"{program}.start")
        done = subprocess.run([sys.executable, "-c", named], capture_output=True, text=True, check=True)
        ours = {"positioner", "positioner.start", program, f"{program}.start"}
        assert set(done.stdout.split()) == ours
