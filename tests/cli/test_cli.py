"""The command line: help with examples, versions, completion, exit statuses, and every mistake of a file at once."""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from plant_emulator.cli import main as plant_main
from positioner import __version__
from positioner.cli import main as positioner_main
from positioner.cli.main import main
from positioner.config.reader import parse_config
from positioner.errors import ExitCode
from positioner.machine.build import version

if TYPE_CHECKING:
    from collections.abc import Iterator

    Output = pytest.CaptureFixture[str]

ROOT = Path(__file__).resolve().parents[2]
WIDEST = 120
GOOD = '[valve]\nid = "FV-101"\npreset = "paper"\n'


def commands(parser: argparse.ArgumentParser) -> Iterator[argparse.ArgumentParser]:
    """Yield `parser` and every parser of a command below it."""
    yield parser
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for below in action.choices.values():
                yield from commands(below)


def is_group(parser: argparse.ArgumentParser) -> bool:
    """Return whether it is a group of commands, each of which has a parser of its own."""
    return any(isinstance(action, argparse._SubParsersAction) for action in parser._actions)


PARSERS = {parser.prog: parser for made in (positioner_main, plant_main) for parser in commands(made.build_parser())}


def run(*arguments: str, module: str = "positioner", **changes: Any) -> subprocess.CompletedProcess[str]:
    """Run one of the programs to its end."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), **changes.pop("env", {})}
    return subprocess.run(
        [sys.executable, "-m", module, *arguments],
        env=environment,
        stderr=subprocess.PIPE,
        text=True,
        check=False,
        timeout=300.0,
        **changes,
    )


def test_every_program_and_command_is_tested() -> None:
    assert {"positioner", "positioner run", "positioner bench", "positioner table reset", "positioner check",
            "plant-emulator", "plant-emulator run"} <= set(PARSERS)  # fmt: skip


@pytest.mark.parametrize("prog", [prog for prog, parser in PARSERS.items() if " " not in prog or not is_group(parser)])
def test_help_fits_the_terminal_and_has_an_example_that_parses(prog: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", str(WIDEST))
    parser = PARSERS[prog]
    text = parser.format_help()
    assert [line for line in text.splitlines() if len(line) > WIDEST] == []
    assert parser.description
    examples = [line.split("example: ")[-1].split("   ")[0].split(" > ")[0] for line in joined(text)]
    examples = [example.strip() for example in examples if f"{example.strip()} ".startswith(f"{prog} ")]
    examples = [example for example in examples if "[" not in example]
    assert examples, text
    program = positioner_main if prog.startswith("positioner") else plant_main
    for example in examples:
        program.build_parser().parse_args(example.split()[1:])


def joined(text: str) -> list[str]:
    """Return the lines of a help text; what argparse wrapped after `example:` is one line again."""
    head, found, tail = text.partition("example: ")
    return [*head.splitlines(), f"{found}{' '.join(tail.split())}"] if found else text.splitlines()


NO_FIGURES = {
    "positioner run": "a daemon: its figures are its log, its trace and its frames",
    "positioner monitor": "it shows a live picture; programs read the metrics",
    "positioner report": "it writes a page",
    "positioner table reset": "it changes the table, and says so",
    "positioner table export": "it writes a JSON file",
    "positioner table import": "it changes the table, and says so",
    "plant-emulator run": "a daemon: its figures are its frames",
    "plant-emulator simulate": "it writes CSV",
    "plant-emulator presets": "it lists names",
}


def test_every_command_that_prints_figures_prints_them_as_json_too() -> None:
    commands = {prog: parser for prog, parser in PARSERS.items() if " " in prog and not is_group(parser)}
    without = {prog for prog, parser in commands.items() if "--json" not in parser.format_help()}
    assert sorted(without - set(NO_FIGURES)) == []
    assert sorted(set(NO_FIGURES) - without) == []


def test_the_exit_statuses_in_the_help_are_those_of_the_program() -> None:
    text = PARSERS["positioner"].format_help()
    for code in set(ExitCode) - {ExitCode.FAILURE, ExitCode.OK}:
        assert f" {code:d} " in text


@pytest.mark.parametrize(("program", "name"), [(positioner_main, "positioner"), (plant_main, "plant-emulator")])
def test_the_version_is_printed(program: Any, name: str, capsys: Output) -> None:
    with pytest.raises(SystemExit) as ended:
        program.main(["--version"])
    assert ended.value.code == ExitCode.OK
    assert capsys.readouterr().out == version(name, __version__) + "\n"


@pytest.mark.parametrize(
    "arguments",
    [[], ["runn"], ["run"], ["run", "--config"], ["bench", "--seed", "x"], ["check"],
     ["check", "--example", "valve.toml"], ["table"], ["table", "dump"]],
)  # fmt: skip
def test_a_wrong_command_line_is_a_usage_error(arguments: list[str], capsys: Output) -> None:
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == ExitCode.USAGE
    assert capsys.readouterr().err.startswith("usage: positioner")


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [("bench --lawn=nmpc", "positioner bench: error: --lawn is unknown; did you mean '--law'? positioner bench --help"),
     ("table reset --state x --yess", "positioner table reset: error: --yess is unknown; did you mean '--yes'? "),
     ("bench nmpc", "positioner bench: error: nmpc is unknown; positioner bench --help lists what there is")],
)  # fmt: skip
def test_what_a_command_does_not_take_is_refused_in_its_name(arguments: str, expected: str, capsys: Output) -> None:
    with pytest.raises(SystemExit) as ended:
        main(arguments.split())
    assert ended.value.code == ExitCode.USAGE
    assert capsys.readouterr().err.splitlines()[-1].startswith(expected)


def test_a_good_configuration_is_printed_with_its_properties(tmp_path: Path, capsys: Output) -> None:
    path = tmp_path / "valve.toml"
    path.write_text(GOOD, encoding="utf-8")
    assert main(["check", str(path)]) == ExitCode.OK
    first, empty, *rows = capsys.readouterr().out.splitlines()
    assert (first, empty) == (f"{path}: good", "")
    shown = dict(re.split(" {2,}", row, maxsplit=1) for row in rows)
    assert shown["valve"] == "FV-101, span 127 mm"
    # B u ± F_s over K_m at 4 and 20 mA, F_s of the span's force, and (F_s - F_c) / K_m
    assert shown["restartable both ways"] == "57.9 to 94.5 mm"
    assert shown["stiction"] == "F_s 32.0 % of the span force"
    assert shown["slip jump"] == "5.42 mm"
    assert shown["bus"] == "socketcan:can0"
    assert shown["bus load"] == "30 % of 1 Mbit/s at most; 90 % at 0.31 ms, the shortest period that fits"


@pytest.mark.parametrize(
    ("valve", "expected"),
    [
        ('preset = "graphite"', "13.1 to 30.0 mm (to the upper stop)"),
        ('preset = "paper"\ntravel_min_m = 0.06', "60.0 to 94.5 mm (to the lower stop)"),
        (
            'preset = "paper"\ntravel_min_m = 0.07\ntravel_max_m = 0.08',
            "70.0 to 80.0 mm (to the lower and the upper stop)",
        ),
        ('preset = "paper"\nstatic_friction_n = 4000.0', "nowhere"),
    ],
)
def test_the_range_of_positions_ends_at_the_stops(valve: str, expected: str, tmp_path: Path, capsys: Output) -> None:
    path = tmp_path / "valve.toml"
    path.write_text(f'[valve]\nid = "v"\n{valve}\n', encoding="utf-8")
    assert main(["check", str(path)]) == ExitCode.OK
    assert f"restartable both ways  {expected}\n" in capsys.readouterr().out


def test_a_period_too_short_for_a_bus_is_reported_with_the_shortest_that_fits(tmp_path: Path, capsys: Output) -> None:
    path = tmp_path / "valve.toml"
    path.write_text(GOOD + "[control]\nsample_period_s = 0.0001\n", encoding="utf-8")
    assert main(["check", str(path)]) == ExitCode.OK
    load = "273 % of 1 Mbit/s at most: more than the bus carries; 90 % at 0.31 ms, the shortest period that fits"
    assert f"\n- FV-101: bus load: {load}\n" in capsys.readouterr().out
    assert main(["check", "--json", str(path)]) == ExitCode.OK
    (valve,) = json.loads(capsys.readouterr().out)["valves"]
    assert valve["bus_load_at_1_mbit_per_s"] == pytest.approx(2.73, abs=0.005)
    page = (ROOT / "docs" / "league.md").read_text(encoding="utf-8")
    assert "take 273 % of 1 Mbit/s" in page
    assert "carries is 0.31 ms" in " ".join(page.split())


def test_a_warning_stands_before_the_good_lines_and_not_among_them(tmp_path: Path, capsys: Output) -> None:
    path = tmp_path / "valve.toml"
    late = "[control]\nsample_period_s = 0.05\n[guard]\nactuator_deadman_s = 0.1\n"
    path.write_text(f'[valve]\nid = "FV-101"\npreset = "paper"\nstatic_friction_n = 4000.0\n{late}', encoding="utf-8")
    assert main(["check", str(path)]) == ExitCode.OK
    first, empty, *lines = capsys.readouterr().out.splitlines()
    assert (first, empty) == (f"{path}: no mistake, but 3 warnings", "")
    end = lines.index("")
    told = (
        "FV-101: error to expect: ",
        "FV-101: no current within the limits",
        "FV-101: the sample period is too long",
    )
    assert [line.startswith(f"- {words}") for line, words in zip(lines[:end], told, strict=True)] == [True] * 3
    assert not re.search("too long|no current|more than", "\n".join(lines[end:]))
    assert main(["check", str(path), "--json"]) == ExitCode.OK
    (valve,) = json.loads(capsys.readouterr().out)["valves"]
    assert [f"- FV-101: {line}" for line in valve["warnings"]] == lines[:end]


def test_a_program_reads_the_properties_and_the_mistakes_of_a_configuration(tmp_path: Path, capsys: Output) -> None:
    path = tmp_path / "valve.toml"
    path.write_text(GOOD, encoding="utf-8")
    assert main(["check", str(path), "--json"]) == ExitCode.OK
    found = json.loads(capsys.readouterr().out)
    assert (found["good"], found["mistakes"]) == (True, [])
    valve = found["valves"][0]
    assert (valve["valve"], valve["span_m"], valve["bus"]) == ("FV-101", 0.127, "socketcan:can0")
    ends_mm = [1e3 * valve[name] for name in ("restartable_low_m", "restartable_high_m")]
    assert ends_mm == pytest.approx([57.9, 94.5], abs=0.05)
    assert valve["static_friction_of_span_force"] == pytest.approx(0.32, abs=5e-4)
    path.write_text(GOOD + "mass_kg = 1361\n", encoding="utf-8")
    assert main(["check", str(path), "--json"]) == ExitCode.CONFIG
    captured = capsys.readouterr()
    (mistake,) = json.loads(captured.out)["mistakes"]
    assert (mistake["where"], mistake["line"], captured.err) == ("valve.mass_kg = 1361", 4, "")


def test_every_mistake_of_a_configuration_comes_at_once_with_its_line(tmp_path: Path, capsys: Output) -> None:
    path = tmp_path / "valve.toml"
    path.write_text(
        '[valve]\nid = "FV-101"\npreset = "paper"\nmass_kg = 1361\ntravel_maks_m = 0.1\n\n[wire]\ndbc = "absent.dbc"\n'
        '\n[control]\nlaw = "papper"\n\n[guard]\nauto_arm = "yes"\n',
        encoding="utf-8",
    )
    assert main(["check", str(path)]) == ExitCode.CONFIG
    captured = capsys.readouterr()
    assert captured.out == ""
    lines = captured.err.splitlines()
    assert [line.removeprefix("positioner: ").split(f"{path}: ")[1].split(": ")[0] for line in lines] == [
        "line 4", "line 5", "line 8", "line 11", "line 14",
    ]  # fmt: skip
    assert "valve.mass_kg = 1361: must be less than or equal to 200" in lines[0]
    assert "valve.travel_maks_m: unknown key; did you mean 'travel_max_m'?" in lines[1]
    assert "absent.dbc': cannot be read: No such file or directory" in lines[2]
    assert "control.law = 'papper': is no law; did you mean 'paper'?" in lines[3]
    assert "guard.auto_arm = 'yes': must be true or false" in lines[4]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("[valve\n", "line 1: TOML"),
        ("", "valve: is required and missing"),
        (GOOD + "[guard]\ncurrent_low_ma = 12.0\ncurrent_high_ma = 8.0\n", "current_low_ma must be below"),
        (GOOD + "[bus]\nport = 0\n", "bus.port = 0"),
    ],
)
def test_run_reports_a_mistake_as_check_does(text: str, expected: str, tmp_path: Path, capsys: Output) -> None:
    path = tmp_path / "valve.toml"
    path.write_text(text, encoding="utf-8")
    for command in (["check", str(path)], ["run", "--config", str(path)]):
        assert main(command) == ExitCode.CONFIG
        (line,) = capsys.readouterr().err.splitlines()
        assert line.startswith(f"positioner: {path}: ")
        assert expected in line


def test_the_example_is_itself_a_good_configuration(tmp_path: Path, capsys: Output) -> None:
    assert main(["check", "--example"]) == ExitCode.OK
    text = capsys.readouterr().out
    assert text.startswith("#")
    assert parse_config(text, "example", tmp_path).valve.id == "FV-101"
    path = tmp_path / "example.toml"
    path.write_text(text, encoding="utf-8")
    assert main(["check", str(path)]) == ExitCode.OK


@pytest.mark.parametrize(
    ("arguments", "status", "expected"),
    [
        (["run", "--config", "absent.toml"], ExitCode.CONFIG, "absent.toml: file: cannot be read: No such file"),
        (["run", "--config", "{valve}", "--bus", "can0"], ExitCode.CONFIG, "bus 'can0' is not INTERFACE:CHANNEL"),
        (["run", "--config", "{valve}", "--state", "/dev/null/x"], ExitCode.IO, "the state directory cannot be made"),
        (["run", "--config", "{valve}", "--state", "{state}", "--trace", "/dev/null/x"], ExitCode.USAGE,
         "trace /dev/null/x cannot be written: Not a directory"),
        (["table", "dump", "--state", "{state}"], ExitCode.IO, "state"),
    ],
)  # fmt: skip
def test_what_cannot_be_done_ends_in_one_line_and_its_status(
    arguments: list[str], status: ExitCode, expected: str, tmp_path: Path, capsys: Output
) -> None:
    places = {"valve": str(tmp_path / "valve.toml"), "state": str(tmp_path / "state")}
    Path(places["valve"]).write_text(GOOD, encoding="utf-8")
    assert main([argument.format(**places) for argument in arguments]) == status
    (line,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("positioner: ")]
    assert expected in line


@pytest.mark.parametrize(
    ("arguments", "status", "expected"),
    [
        (["--seed", "-1"], ExitCode.USAGE, "'-1' is no whole number"),
        (["--period", "0"], ExitCode.USAGE, "'0' is not seconds"),
        (["--preset", "steel"], ExitCode.USAGE, "steel"),
        (["--bus", "vcan0"], ExitCode.CONFIG, "bus 'vcan0' is not INTERFACE:CHANNEL"),
        (["--id-offset", "3"], ExitCode.CONFIG, "must be a multiple of 128"),
        (["--config", "absent.toml"], ExitCode.CONFIG, "absent.toml: file: cannot be read"),
    ],
)
def test_an_emulator_that_cannot_run_gives_the_reason(
    arguments: list[str], status: ExitCode, expected: str, capsys: Output
) -> None:
    try:
        code = plant_main.main(["run", *arguments])
    except SystemExit as ended:  # argparse's own way
        code = int(str(ended.code))
    assert code == status
    assert expected in capsys.readouterr().err.splitlines()[-1]


def test_an_interrupt_ends_as_shells_expect(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted() -> str:
        raise KeyboardInterrupt

    monkeypatch.setattr("positioner.cli.check.example_text", interrupted)
    assert main(["check", "--example"]) == 130


@pytest.mark.bus
def test_a_reader_that_has_gone_is_no_error() -> None:
    reader, writer = os.pipe()
    os.close(reader)
    try:
        done = run("check", "--example", stdout=writer)
    finally:
        os.close(writer)
    assert (done.returncode, done.stderr) == (ExitCode.OK, "")
