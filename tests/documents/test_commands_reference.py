"""The reference of the commands and the man pages: every command, every option, every example, and good roff."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from documents.commands import Command, page, programs
from documents.manual import pages

PROGRAMS = programs()
COMMANDS = [each for program in PROGRAMS for each in program.all()]
MAN = pages()


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: " ".join(command.words))
def test_the_reference_has_the_options_and_the_examples_of_every_command(command: Command) -> None:
    text = page(next(program for program in PROGRAMS if program.words[0] == command.words[0]))
    assert command.usage in text
    for option in command.options:
        assert option.text, f"{' '.join(command.words)} {option.written} has no help"
        assert f"| `{option.written.replace('|', chr(92) + '|')}` |" in text
    examples = [line for line in command.epilog.splitlines() if line.startswith("  positioner ")]
    assert all(line in text for line in examples)


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda program: program.words[0])
def test_every_command_tells_its_exit_statuses_or_the_program_does(program: Command) -> None:
    told = {each.words for each in program.all() if "exit status: " in each.epilog}
    assert program.words in told
    silent = [each.words for each in program.commands if each.words not in told]
    assert silent == ([] if program.words == ("positioner",) else [each.words for each in program.commands])


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: " ".join(command.words))
def test_a_default_is_written_in_one_way_and_with_its_unit(command: Command) -> None:
    for option in command.options:
        assert not re.search(r"\(\d[^)]*\)$", option.text), option
        default = re.search(r"default: (-?[\d.]+)(?![\d.]*,)(?P<unit> \w+)?", option.text)
        if default and option.written.endswith((" S", " MA")):
            assert default["unit"] == (" s" if option.written.endswith(" S") else " mA"), option


def test_the_list_of_commands_has_every_command() -> None:
    text = (Path(__file__).resolve().parents[2] / "docs" / "commands.md").read_text(encoding="utf-8")
    commands = [each for program in PROGRAMS for each in program.commands]
    assert [each.words for each in commands if f"`{' '.join(each.words)}" not in text] == []


def test_each_command_has_a_man_page_with_its_name_its_options_and_a_way_back() -> None:
    assert {"positioner.1", "positioner-run.1", "positioner-table.1", "plant-emulator.1"} <= MAN.keys()
    assert len(MAN) == 2 + sum(len(program.commands) for program in PROGRAMS)
    run = MAN["positioner-run.1"].splitlines()
    assert run[0].startswith(".TH POSITIONER-RUN 1")
    assert [line for line in run if line.startswith(".SH ")] == [
        ".SH NAME", ".SH SYNOPSIS", ".SH DESCRIPTION", ".SH OPTIONS", ".SH NOTES", ".SH SEE ALSO",
    ]  # fmt: skip
    assert ".B \\-\\-dry\\-run" in run
    assert run[-1] == ".BR positioner (1)"
    assert ".BR positioner\\-run (1)" in MAN["positioner.1"].splitlines()


@pytest.mark.parametrize("name", MAN)
def test_no_line_of_a_man_page_is_a_request_by_accident(name: str) -> None:
    known = (".TH ", ".SH ", ".SS ", ".TP", ".B ", ".BR ", ".PP", ".nf", ".fi")
    for line in MAN[name].splitlines():
        assert not line.startswith("'")
        assert not line.startswith(".") or line.startswith(known), line


def test_the_formatter_of_this_machine_finds_nothing_wrong(tmp_path: Path) -> None:
    subprocess.run([sys.executable, "-m", "documents.manual", str(tmp_path)], check=True, timeout=300)
    written = sorted(tmp_path.glob("*.1"))
    assert len(written) == len(MAN)
    if formatter := shutil.which("groff"):
        command = [formatter, "-man", "-Tutf8", "-Kutf8", "-ww", "-z", *map(str, written)]
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
        assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
