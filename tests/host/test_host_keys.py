"""The keys of a session: what a terminal sends for them, what they mean, what Tab offers, the lines of the status."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st

from positioner.host.interactive import _csv_files
from positioner.host.key_control import KeyControl
from positioner.host.keys import KeyReader
from positioner.host.snapshot import Snapshot
from positioner.host.status_block import status_block
from positioner.host.verbs import Verb, Word
from positioner.host.word_choices import choices
from positioner.wire.messages import Cause, Health, Mode, PositionerStatus, Quality

if TYPE_CHECKING:
    from pathlib import Path

SEQUENCES = {
    b"\x1b[A": ["up"],
    b"\x1bOB": ["down"],
    b"\x1b[1;2A": ["shift-up"],
    b"\x1b[1;2B": ["shift-down"],
    b"\x1b[C\x1b[D": ["right", "left"],
    b"a\r\n\t": ["a", "enter", "enter", "tab"],
    b"\x7f\x08\x15\x04": ["backspace", "backspace", "clear", "end of input"],
    b"\x1b[200~m\x1b[201~": ["paste", "m", "pasted"],
    "é→".encode(): ["é", "→"],
    b"\x1b[15~\x1b[1;5A\x00\x01": ["up"],
    b"\x1bx": ["escape", "x"],
}
SILENT = Snapshot("V", 0.127, None, None, Quality.VALID, None, None, None, {})
STATUS = PositionerStatus(
    mode=Mode.ACTIVE,
    cause=Cause.VALVE_DIFFERS,
    health=Health.MAINTENANCE_REQUIRED,
    armed=True,
    table_saved=True,
    fallback_count=0,
    rejected_count=0,
    learned_count=0,
)
ACTIVE = Snapshot("V", 0.127, STATUS, 0.0801, Quality.VALID, 0.08, 12.345, None, {})


@pytest.mark.parametrize(("data", "keys"), SEQUENCES.items())
def test_a_key_is_known_however_its_sequence_is_cut(data: bytes, keys: list[str]) -> None:
    for cut in range(len(data) + 1):
        reader = KeyReader()
        assert reader.feed(data[:cut]) + reader.feed(data[cut:]) == keys


def test_escape_alone_is_a_key_when_nothing_follows() -> None:
    reader = KeyReader()
    assert reader.feed(b"\x1b") == []
    assert reader.flush() == ["escape"]
    assert reader.flush() == []
    assert reader.feed(b"\x1b[") == []
    assert reader.flush() == []
    assert reader.feed(b"A") == ["up"]


def control() -> KeyControl:
    return KeyControl(lambda line: choices(line, lambda begin: [f"{begin}.csv"]))


def pressed(it: KeyControl, keys: str) -> list[Verb | str]:
    return [each for key in KeyReader().feed(keys.encode()) for each in it.key(key)[0]]


@pytest.mark.parametrize(
    ("keys", "verb"),
    [
        ("\x1b[A", Verb(Word.SET, step_percent=1.0)),
        ("\x1b[B", Verb(Word.SET, step_percent=-1.0)),
        ("\x1b[1;2B", Verb(Word.SET, step_percent=-0.1)),
        ("+", Verb(Word.SET, step_percent=0.1)),
        ("\x1b[C", Verb(Word.SET, step_percent=10.0)),
        ("\x1b[D", Verb(Word.SET, step_percent=-10.0)),
        ("m", Verb(Word.MANUAL)),
        ("a", Verb(Word.AUTO)),
        ("q", Verb(Word.QUIT)),
        ("\x04", Verb(Word.QUIT)),
    ],
)
def test_a_key_on_an_empty_line_acts_at_once(keys: str, verb: Verb) -> None:
    assert pressed(control(), keys) == [verb]


@pytest.mark.parametrize(
    ("keys", "lines"),
    [
        ("set 80\r", ["set 80"]),
        (":arm\r:manual 9.5mA\r", ["arm", "manual 9.5mA"]),
        ("sets\x7f 80\r", ["set 80"]),
        ("se\x1b[A\x1b[Bt 80\r", ["set 80"]),
        ("set 80\x15", []),
        (":\r", []),
        ("  \x1b[5~\r", []),
        ("\x1b[200~arm\rmanual 9.5mA\x1b[201~\r", ["arm manual 9.5mA"]),
    ],
)
def test_a_typed_line_begins_with_enter_and_no_key_of_it_moves_the_valve(keys: str, lines: list[str]) -> None:
    it = control()
    assert pressed(it, keys) == lines
    assert not it.is_typing


def test_backspace_and_escape_leave_the_line() -> None:
    for end in ("\x7f\x7f", "\x1b"):
        it = control()
        reader = KeyReader()
        for key in [*reader.feed(f"s{end}".encode()), *reader.flush()]:
            assert it.key(key) == ([], [])
        assert not it.is_typing
        assert pressed(it, "m") == [Verb(Word.MANUAL)]


@pytest.mark.parametrize(
    ("typed", "line", "offered"),
    [
        (":ar", "arm ", []),
        ("s", "s", ["set  status"]),
        ("st", "status ", []),
        ("set 80", "set 80", ["80mm  80%"]),
        ("set 80 m", "set 80 m", ["mm  manual"]),
        (":manual 9.5", "manual 9.5mA ", []),
        ("profile st", "profile st.csv ", []),
        ("profile a.csv r", "profile a.csv repeat ", []),
        ("profile a.csv repeat f", "profile a.csv repeat forever ", []),
        (":x", "x", []),
    ],
)
def test_tab_completes_verbs_units_and_files(typed: str, line: str, offered: list[str]) -> None:
    it = control()
    pressed(it, typed)
    assert it.key("tab") == ([], offered)
    assert it.line == line


def test_tab_offers_csv_files_and_folders(tmp_path: Path) -> None:
    (tmp_path / "steps.csv").touch()
    (tmp_path / "steps.txt").touch()
    (tmp_path / "steps").mkdir()
    assert _csv_files(f"{tmp_path}/st") == [f"{tmp_path}/steps/", f"{tmp_path}/steps.csv"]


def test_the_status_has_mode_position_setpoint_and_current() -> None:
    assert status_block(ACTIVE, "", "", None, (81, 24)) == [
        "ACTIVE: the valve does not move as configured; measure it: positioner identify",
        "(NE 107: maintenance required)",
        "position 80.10 mm (63.07 %)   setpoint 80.00 mm (62.99 %)   current 12.345 mA",
        "up/down 1 %, left/right 10 %, +/- 0.1 %, m manual, a auto, q quit, : a verb",
    ]
    assert status_block(SILENT, "nothing comes", "", "set 8", (80, 24)) == [
        "nothing comes",
        "position –   setpoint –   current –",
        "> set 8",
    ]


def test_a_narrow_terminal_has_a_line_for_each_figure() -> None:
    lines = status_block(ACTIVE, "", "steps.csv: 1.0 of 2 s", None, (30, 24))
    assert lines[-5:-1] == [
        "position 80.10 mm (63.07 %)",
        "setpoint 80.00 mm (62.99 %)",
        "current 12.345 mA",
        "profile steps.csv: 1.0 of 2 s",
    ]


@given(
    st.sampled_from([ACTIVE, SILENT]),
    st.text(max_size=200),
    st.none() | st.text(st.characters(codec="ascii", categories=("L", "N")), max_size=200),
    st.tuples(st.integers(1, 200), st.integers(1, 60)),
)
def test_the_status_fits_every_terminal(
    found: Snapshot, progress: str, typed: str | None, size: tuple[int, int]
) -> None:
    lines = status_block(found, "nothing comes", progress, typed, size)
    assert 1 <= len(lines) <= max(size[1] - 1, 1)
    assert all(len(line) <= max(size[0] - 1, 3) for line in lines)
