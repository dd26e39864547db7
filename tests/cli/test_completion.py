"""Completion in a real bash that has no Python: the script of `--completion bash` is all that it needs."""

from __future__ import annotations

import argparse
import os
import re
import shlex
import shutil
import subprocess
from typing import TYPE_CHECKING

import pytest

from plant_emulator.cli import main as plant_main
from positioner.cli import main as positioner_main
from positioner.laws.registry import law_names
from positioner.machine.completion import SHELLS, _actions, _offer, completion

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

PROGRAMS = {"positioner": positioner_main, "plant-emulator": plant_main}
OPEN = re.compile(
    r"N|S|X|T|MA|MIB|MA_PER_S|PERCENT|PERCENT,…|MS,MS,…|N,M,…|A,B|LOW:HIGH|LOW-HIGH|AREA|COLUMN|NAMES|ADDRESS|KEY=VALUE"
    r"|KIND:SIZE|INTERFACE:CHANNEL(\[,OPTION=VALUE\.\.\.\])?"
)
"""The metavars of values that no list holds."""
TWO_VALVES = """\
[bus]
channel = "can0"

[[valve]]
id = "FV-101"   # the first
preset = "paper"

[[valve]]
  id="FV-102"
preset = "graphite"
wire.id_offset = 128
"""
ASK = """
complete=$(complete -p {program}); function=${{complete##*-F }}; function=${{function%% *}}
COMP_WORDS=({words}); COMP_CWORD={last}; COMP_LINE={line}; COMP_POINT=${{#COMP_LINE}}
"$function" {program} "${{COMP_WORDS[COMP_CWORD]}}" "${{COMP_WORDS[COMP_CWORD-1]}}"
printf '%s\\n' "${{COMPREPLY[@]}}"
"""


@pytest.fixture(scope="module")
def scripts(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder with what each program prints for bash, and with the only tool that it may call."""
    folder = tmp_path_factory.mktemp("completion")
    for name, program in PROGRAMS.items():
        (folder / name).write_text(completion(program.build_parser(), "bash"), encoding="utf-8")
    sed = shutil.which("sed")
    assert sed
    (folder / "path").mkdir()
    (folder / "path/sed").symlink_to(sed)
    return folder


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("fv101.toml", "two.toml", "notes.txt", "loop.csv", "trend.png", "my_law.py"):
        (tmp_path / name).write_text(TWO_VALVES if name == "two.toml" else "", encoding="utf-8")
    (tmp_path / "benches").mkdir()
    return tmp_path


def complete(scripts: Path, folder: Path, *lines: str) -> list[set[str]]:
    """Return what bash offers for the last word of each line."""
    asked = [f"source {scripts}/positioner; source {scripts}/plant-emulator"]
    for line in lines:
        words = [part for word in shlex.split(line) for part in re.findall(r"=|[^=]+", word)]  # as bash splits them
        words += [""] if line.endswith(" ") else []
        values = {"program": words[0], "words": shlex.join(words), "last": len(words) - 1, "line": shlex.quote(line)}
        asked += [ASK.format(**values), "echo ---"]
    bash = shutil.which("bash")
    assert bash
    done = subprocess.run(
        [bash, "--noprofile", "--norc", "-c", "\n".join(asked)],
        capture_output=True,
        text=True,
        check=False,
        cwd=folder,
        env={"PATH": str(scripts / "path"), "HOME": str(folder)},
        timeout=300,
    )
    assert not done.stderr
    answers = done.stdout.split("---\n")[:-1]
    assert len(answers) == len(lines)
    return [set(answer.split()) for answer in answers]


def commands(parser: argparse.ArgumentParser) -> Iterator[tuple[str, set[str]]]:
    """Yield each command line that only lacks its options, with the options."""
    known = {name for action in parser._actions for name in action.option_strings if action.help != argparse.SUPPRESS}
    yield parser.prog, known
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for below in action.choices.values():
                yield from commands(below)


@pytest.mark.parametrize("program", PROGRAMS)
def test_every_command_offers_every_option(scripts: Path, folder: Path, program: str) -> None:
    expected = dict(commands(PROGRAMS[program].build_parser()))
    assert len(expected) > 3
    answers = complete(scripts, folder, *(f"{prog} -" for prog in expected))
    assert dict(zip(expected, answers, strict=True)) == expected


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("positioner ben", {"bench"}),
        ("positioner table re", {"reset"}),
        ("positioner bench --la", {"--law"}),
        ("positioner bench --law ", {*law_names(), "my_law.py", "benches"}),
        ("positioner bench --law=nm", {"nmpc"}),
        ("positioner bench --clock=", {"lockstep", "realtime"}),
        ("positioner bench --law=nmpc --plant=g", {"graphite"}),
        ("positioner host --config=two.toml --valve FV-102", {"FV-102"}),
        ("positioner bench --plant g", {"graphite"}),
        ("positioner league --laws nmpc,pa", {"nmpc,paper", "nmpc,paper-plain"}),
        ("positioner bench --scenario t", {"two.toml"}),
        ("positioner bench --seed 3 --law nm", {"nmpc"}),
        ("positioner --completion ", set(SHELLS)),
        ("positioner check ", {"fv101.toml", "two.toml", "benches"}),
        ("positioner run --config t", {"two.toml"}),
        ("positioner run --config two.toml --trace l", {"loop.csv"}),
        ("positioner identify --picture ", {"trend.png", "benches"}),
        ("positioner diagnose n", {"notes.txt"}),
        ("positioner bench --out ", {"benches"}),
        ("positioner host --config two.toml --valve ", {"FV-101", "FV-102"}),
        ("positioner host --config ~/two.toml --valve FV-102", {"FV-102"}),
        ("positioner host --config none.toml --valve ", set()),
        ("positioner host --config two.toml a", {"arm", "auto"}),
        ("positioner host --config two.toml arm s", {"set", "status"}),
        ("plant-emulator run --preset gr", {"graphite"}),
        ("plant-emulator simulate --out ", {"loop.csv", "benches"}),
        ("positioner bench --seed ", set()),
        ("positioner bench --bus ", {"auto"}),
        ("positioner step-test --law h", {"hold"}),
        ("positioner step-test --law pi-", {"pi-deadband"}),
        ("positioner health --acknowledge fri", {"friction_high", "friction_low"}),
        (
            "positioner league --real-valves --conditions lag-",
            {"lag-not-configured", "lag-30-not-configured", "lag-1000"},
        ),
        ("positioner league --real-valves --rival-plants gr", {"graphite"}),
        ("plant-emulator simulate --input ", {"ramp", "step", "triangle", "loop.csv", "benches"}),
    ],
)
def test_a_shell_offers_what_can_stand_there(scripts: Path, folder: Path, line: str, offered: set[str]) -> None:
    assert complete(scripts, folder, line) == [offered]


@pytest.mark.parametrize("program", PROGRAMS)
def test_a_value_that_a_list_or_a_folder_holds_is_completed(program: str) -> None:
    values = [each for each in _actions(PROGRAMS[program].build_parser()) if each.nargs != 0 and not each.choices]
    assert len(values) > 10
    assert [each.option_strings for each in values if not OPEN.fullmatch(str(each.metavar)) and not _offer(each)] == []


@pytest.mark.parametrize("shell", SHELLS)
@pytest.mark.parametrize("program", PROGRAMS)
def test_a_program_prints_its_completion_and_ends(program: str, shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        PROGRAMS[program].main(["--completion", shell])
    assert ended.value.code == 0
    printed = capsys.readouterr().out
    assert re.search(rf"^(#compdef |complete .*){program}$|^complete -c {program}", printed, flags=re.MULTILINE)
    interpreter = shutil.which(shell)
    if interpreter:  # bash is always there
        subprocess.run([interpreter, "-n"], input=printed, text=True, check=True, env=dict(os.environ), timeout=300)
