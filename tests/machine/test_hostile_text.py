"""Text of other people that a terminal would obey: names of files, ids, units, cells, log lines; none arrives raw."""

from __future__ import annotations

import ast
import io
import json
import logging
import os
import pty
import socket
import subprocess
import sys
import unicodedata
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st

from positioner.cli import tables
from positioner.cli.main import main
from positioner.config.reader import parse_config
from positioner.errors import ConfigurationError, ExitCode, Problem, UsageError, in_one_line, visible
from positioner.host.profile_file import read_profile
from positioner.host.verbs import Verb, Word
from positioner.machine.console import Parser, run_command
from positioner.machine.journal import SinkHandler
from positioner.machine.line_sink import LineSink
from positioner.machine.notify import Notifier
from positioner.metrics.writer import Problems
from positioner.monitor.screen import source_line
from positioner.report.table import Table

if TYPE_CHECKING:
    from positioner.errors import PositionerError

ROOT = Path(__file__).resolve().parents[2]
EVIL = "\x1b[2J\x1b]0;owned\x07\r\x9b31m\u202etxt"
"""Clear the screen, name the window, go back to the begin of the line, a one-byte CSI, text from right to left."""
SHOWN = r"\u001b[2J\u001b]0;owned\u0007\u000d\u009b31m\u202etxt"


def is_safe(text: str) -> bool:
    """Return whether a terminal shows each character: none is a control, but for the end of a line, or a direction."""
    controls = [each for each in text if unicodedata.category(each) == "Cc" and each not in "\n\t"]
    turned = [each for each in text if unicodedata.bidirectional(each) in {"LRE", "RLE", "LRO", "RLO", "PDF", "LRI"}]
    return not controls and not turned


@given(st.text())
def test_whatever_the_text_only_what_a_terminal_shows_is_left(text: str) -> None:
    shown = visible(text)
    assert is_safe(shown)
    assert visible(shown) == shown
    assert "\n" not in in_one_line(text)
    shown.encode("utf-8")  # no half of a surrogate pair either


@given(st.text(st.characters(categories=["L", "M", "N", "P", "S", "Zs"])))
def test_text_that_is_shown_stays_as_it_is(text: str) -> None:
    assert visible(text) == text


def test_lines_stay_where_they_are_a_text_and_become_visible_where_one_line_is_meant() -> None:
    assert visible("one\n\ttwo\x1b") == "one\n\ttwo\\u001b"
    assert in_one_line("one\ntwo") == "one\\ntwo"


@pytest.mark.parametrize("how", [{}, {"as_markdown": True}])
def test_cells_lines_and_captions_of_a_table_are_made_visible(
    how: dict[str, bool], capsys: pytest.CaptureFixture[str]
) -> None:
    table = Table((EVIL, "x"), ((f"{EVIL}\n| forged", "1"),), caption=EVIL)
    tables.show([EVIL, table], **how)
    tables.put(EVIL)
    tables.note(EVIL)
    captured = capsys.readouterr()
    assert captured.out.count(SHOWN) == 5
    assert is_safe(captured.out)
    assert captured.err == f"{SHOWN}\n"
    assert not [line for line in captured.out.splitlines() if line.startswith("| forged")]


def test_a_json_document_is_safe_to_show_and_says_the_same(capsys: pytest.CaptureFixture[str]) -> None:
    tables.show_json({"name": EVIL})
    shown = capsys.readouterr().out
    assert is_safe(shown)
    assert json.loads(shown) == {"name": EVIL}


def test_a_terminal_gets_the_escapes_of_the_table_and_none_of_its_cells() -> None:
    code = f"from positioner.cli import tables\nfrom positioner.report.table import Table\nE = {EVIL!r}\n"
    code += "tables.show([E, Table(('name', 'n'), ((E, '1'),), caption=E)])\n"
    ours, theirs = pty.openpty()
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "200", "PYTHONUTF8": "1"}
    with subprocess.Popen([sys.executable, "-c", code], stdout=theirs, env=environment) as process:
        os.close(theirs)
        data = b""
        while True:
            try:
                part = os.read(ours, 1 << 16)
            except OSError:
                break
            if not part:
                break
            data += part
        assert process.wait(60.0) == 0
    os.close(ours)
    shown = data.decode()
    assert shown.count(SHOWN) == 3
    assert "\x1b[1m" in shown  # its own: bold
    for each in ("\x1b[2J", "\x1b]0", "\x07", "\x9b", "\u202e"):
        assert each not in shown


def errors() -> list[tuple[PositionerError, int]]:
    with pytest.raises(ConfigurationError) as caught:
        parse_config(f'[valve]\nid = "x"\npreset = {json.dumps(EVIL)}\n', f"{EVIL}\nforged: good", Path())
    return [(UsageError(f"{EVIL}\nforged: good"), 2), (caught.value, 78)]


@pytest.mark.parametrize(("error", "status"), errors(), ids=["usage", "configuration"])
def test_an_error_is_one_line_that_a_terminal_shows(
    error: PositionerError, status: int, capsys: pytest.CaptureFixture[str]
) -> None:
    def fails(_arguments: object) -> ExitCode:
        raise error

    parser = Parser(prog="positioner")
    parser.set_defaults(run=fails)
    assert run_command(parser, []) == status
    shown = capsys.readouterr().err
    assert shown.count("\n") == 1
    assert is_safe(shown)
    assert r"\u001b[2J" in shown


def test_a_message_stays_short_when_each_of_its_characters_is_written_as_six() -> None:
    assert len(str(Problem("\x1b" * 5000, 1, "\x1b" * 5000))) < 1300


def test_a_file_that_is_called_so_and_an_option_too_are_told_visibly(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", str(tmp_path / f"{EVIL}\nvalve.toml: good")]) == ExitCode.CONFIG
    first = capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["check", "valve.toml", f"--{EVIL}\nforged: good"])
    second = capsys.readouterr().err
    assert first.count("\n") == 1
    assert not [line for line in second.splitlines() if line.startswith("forged")]
    for shown in (first, second):
        assert is_safe(shown)
        assert SHOWN in shown


def test_units_of_a_dbc_and_cells_of_a_profile_are_told_visibly(tmp_path: Path) -> None:
    dbc = 'VERSION ""\nBU_: PLANT POSITIONER\nBO_ 512 FEEDBACK: 8 PLANT\n'
    dbc += f' SG_ P : 0|32@1+ (0.001,0) [0|0] "{EVIL}" POSITIONER\n'
    (tmp_path / "own.dbc").write_text(dbc, encoding="utf-8", newline="")
    text = '[valve]\nid = "v"\npreset = "paper"\n[wire]\ndbc = "own.dbc"\n'
    text += '[wire.stem_position]\nmessage = "FEEDBACK"\nsignals = { position_m = "P" }\n'
    with pytest.raises(ConfigurationError) as caught:
        parse_config(text, "valve.toml", tmp_path)
    assert is_safe(str(caught.value))
    assert r"\u001b]0;owned" in str(caught.value)
    valve = parse_config('[valve]\nid = "v"\npreset = "paper"\n', "valve.toml", tmp_path)
    profile = tmp_path / "profile.csv"
    profile.write_text(f"time_s,setpoint_mm\n0,{EVIL.replace(chr(13), '')}\n1,80\n", encoding="utf-8")
    with pytest.raises(ConfigurationError) as caught:
        read_profile(Verb(Word.PROFILE, file=str(profile)), valve.valve, valve.guard)
    assert is_safe(str(caught.value))
    assert r"\u001b" in str(caught.value)


def test_a_line_of_the_log_stays_one_and_is_visible() -> None:
    stream = io.StringIO()
    handler = SinkHandler(LineSink.of(stream))
    handler.emit(logging.makeLogRecord({"msg": "%s", "args": (f"{EVIL}\nINFO all is well",), "levelname": "WARNING"}))
    assert stream.getvalue() == f"WARNING {SHOWN}\\nINFO all is well\n"


def test_the_metrics_writer_and_the_service_manager_get_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    Problems().tell(f"{EVIL}\nINFO")
    assert capsys.readouterr().err == f"WARNING metrics: {SHOWN}\\nINFO\n"
    address = str(tmp_path / "notify")
    monkeypatch.setenv("NOTIFY_SOCKET", address)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(address)
        notifier = Notifier()
        notifier.send(STATUS="ended: law\nMAINPID=1")
        notifier.close()
        assert manager.recv(1000) == b"STATUS=ended: law\\nMAINPID=1"


def test_the_monitor_shows_the_name_of_a_log_visibly() -> None:
    line = source_line(f"{EVIL}\nx", None, in_trouble=False, frozen=False, width=200)
    assert is_safe(line.plain)


def plain_writes(path: Path) -> list[int]:
    """Return the lines in which a file writes a text with values to a standard stream by itself."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call)]
    of_streams = [node for node in calls if ast.unparse(node.func) in {"sys.stdout.write", "sys.stderr.write", "print"}]
    return [node.lineno for node in of_streams if node.args and any(map(needs_care, ast.walk(node.args[0])))]


def needs_care(node: ast.AST) -> bool:
    return isinstance(node, ast.FormattedValue) and not (
        isinstance(node.value, ast.Call) and ast.unparse(node.value.func) in SAFE
    )


SAFE = {"showable", "visible", "in_one_line", "json.dumps", "completion"}
ALLOWED = {
    "start.py": "it may import nothing; the text is that of an import of our own",
    "cli/explain.py": "JSON in ASCII, command by command",
    "host/terminal.py": "the text is made of showable lines, directly above",
}


def test_what_commands_print_goes_through_what_makes_it_visible() -> None:
    package = ROOT / "positioner"
    found = {str(path.relative_to(package)): plain_writes(path) for path in sorted(package.rglob("*.py"))}
    assert {name: lines for name, lines in found.items() if lines and name not in ALLOWED} == {}
