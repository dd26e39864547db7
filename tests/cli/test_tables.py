"""Tables as they are shown: in a terminal of any width, in a pipe, in a document, in ASCII."""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING

import pytest
from host_in_terminal import InTerminal
from hypothesis import given
from hypothesis import strategies as st
from screens import PLAIN, shown
from store_helpers import series, taught

from positioner.cli.tables import show_json
from positioner.errors import ExitCode
from positioner.report.table import Table
from positioner.report.text import is_numeric, unmarked
from positioner.store import access

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

LEAGUE = Table.of(
    ("law", "nominal, %", "worst plant, %", "settles to 1 %, ms", "travel / ideal", "verdict"),
    [
        ("`nmpc`", "0.046", "0.056 (stochastic)", "6.3", "1.02", "met"),
        ("`nmpc-without-table`", "12.345", "0.10 (paper)", "never", "–", "**not met**"),
    ],
)
PIPED = """\
                    nominal  worst plant         settles to 1 %
law                       %  %                               ms  travel / ideal  verdict
────────────────────────────────────────────────────────────────────────────────────────
nmpc                  0.046  0.056 (stochastic)             6.3            1.02  met
nmpc-without-table   12.345  0.10 (paper)                 never               –  not met
"""


def test_a_pipe_gets_plain_aligned_text_of_any_width() -> None:
    assert shown([LEAGUE]) == PIPED


def test_markdown_is_printed_where_it_is_asked_for() -> None:
    head, rule, first, _ = shown([LEAGUE], 60, as_markdown=True).splitlines()
    assert head == "| law | nominal, % | worst plant, % | settles to 1 %, ms | travel / ideal | verdict |"
    assert rule == "| --- | --- | --- | --- | --- | --- |"
    assert first == "| `nmpc` | 0.046 | 0.056 (stochastic) | 6.3 | 1.02 | met |"


def test_a_bar_in_a_cell_is_no_border_in_markdown() -> None:
    assert shown([Table.of(("mean |e|",), [("1",)])], as_markdown=True).startswith("| mean \\|e\\| |\n")


@pytest.mark.parametrize("width", [120, 80, 60, 40, 24])
def test_a_terminal_shows_every_figure_whole_within_its_width(width: int) -> None:
    lines = shown([LEAGUE], width, environment=PLAIN).splitlines()
    assert max(map(len, lines)) <= width
    words = " ".join(lines).split()
    for cell in ("0.046", "12.345", "6.3", "never", "1.02", "0.056", "0.10", "(paper)"):
        assert cell in words, lines


def test_numbers_stand_at_the_right_and_words_at_the_left() -> None:
    lines = shown([LEAGUE], 120, environment=PLAIN).splitlines()
    first, second = lines[3:]
    assert first.index("0.046") + len("0.046") == second.index("12.345") + len("12.345")
    assert first.index("met") == second.index("not met")


def test_a_table_that_does_not_fit_is_split_and_each_part_names_its_rows() -> None:
    text = shown([LEAGUE], 40, environment=PLAIN)
    assert text.count("nmpc-without-table") == text.count("─ \n") + text.count("─\n") > 1


@pytest.mark.parametrize(
    ("environment", "coloured"), [({}, True), ({"NO_COLOR": "1"}, False), ({"TERM": "dumb"}, False)]
)
def test_colours_come_only_where_they_are_wanted(environment: dict[str, str], coloured: bool) -> None:
    assert ("\x1b[36m" in shown([LEAGUE, "`code`"], 120, environment=environment)) is coloured


def test_a_pipe_never_gets_an_escape_sequence() -> None:
    assert "\x1b" not in shown([LEAGUE, "**strong**"], environment={"FORCE_COLOR": "1"})


@pytest.mark.parametrize("width", [None, 60])
def test_ascii_columns_are_aligned_after_the_characters_are_replaced(width: int | None) -> None:
    table = Table.of(("limit, µm", "figure"), [("≤ 0.05", "1 → 2"), ("≤ 10.50", "–")])
    text = shown([table], width, encoding="ascii", environment=PLAIN)
    assert [line.rstrip() for line in text.splitlines()] == [
        "   limit",
        "      um  figure",
        "----------------",
        " <= 0.05  1 -> 2",
        "<= 10.50       -",
    ]


def test_lines_lose_their_marks_and_a_command_stays_one_line() -> None:
    command = "`positioner bench --scenario corners/nmpc-1.toml --law nmpc --seed 3 --out corners/nmpc-1`"
    text = shown(["# Title", "a **strong** word", f"  {command}"], 40, environment=PLAIN)
    assert text.splitlines() == ["Title", "a strong word", f"  {command[1:-1]}"]


@pytest.mark.parametrize("width", [None, 80])
def test_a_comment_of_a_command_is_no_heading(width: int | None) -> None:
    line = "  `positioner reach --config fv101.toml  # what would help`"
    text = shown(["## Title", line], width, environment=PLAIN)
    assert text == f"Title\n{line.replace('`', '')}\n"


@pytest.mark.parametrize(
    ("cells", "numeric"),
    [
        (("1.0", "–", "never"), True),
        (("0.4 (0.39–0.41)", "≤ 3"), True),
        (("1.60 → 1.60",), True),
        (("0 to 5", "−5 to 0.98", "not measured"), True),
        (("1 to mm",), False),
        (("−3.2", "+1e"), False),
        (("0.40 (paper)",), False),
        (("–", "never"), False),
        ((), False),
    ],
)
def test_a_column_of_numbers_is_known_by_its_cells(cells: Sequence[str], numeric: bool) -> None:
    assert is_numeric(cells) is numeric


@pytest.mark.bus
@pytest.mark.parametrize(("width", "environment"), [(60, {}), (200, {"LC_ALL": "C"}), (80, {"TERM": "dumb"})])
def test_a_command_shows_its_table_in_a_real_terminal(width: int, environment: dict[str, str], tmp_path: Path) -> None:
    access.replace(tmp_path, taught(series(200)), force=False)
    arguments = ("-m", "positioner", "table", "dump", "--state", str(tmp_path))
    with InTerminal(program=arguments, size=(width, 250), environment={"COLUMNS": str(width), **environment}) as it:
        assert it.ended() == ExitCode.OK
        screen = it.text
    plus = "+-" if environment else "±"
    assert screen.startswith("valve FV-101: 200 samples in 30 cells of 5 mm")
    assert f"Mean {plus} spread" in screen
    rows = [line for line in it.lines if re.match(r"\s*\d+\.0  (opening|closing)", line)]
    places = {(key.index, key.direction) for key, _ in taught(series(200)).table}
    parts = len(rows) / len(places)
    assert parts == {60: 3, 200: 1, 80: 2}[width]
    assert sum(line.count(plus) for line in rows) == len(list(taught(series(200)).table))
    assert it.received.isascii() is bool(environment)
    assert (b"\x1b" in it.received) is (environment.get("TERM") != "dumb")


CELL = st.text(st.characters(codec="ascii", categories=("L", "N", "P")), max_size=12) | st.floats(-1e6, 1e6).map(str)


@given(
    st.integers(1, 6).flatmap(lambda n: st.lists(st.lists(CELL, min_size=n, max_size=n), min_size=2, max_size=6)),
    st.integers(52, 120),
)
def test_whatever_the_table_and_the_terminal_nothing_is_lost_or_too_wide(rows: list[list[str]], width: int) -> None:
    lines = shown([Table.of(rows[0], rows[1:])], width, environment=PLAIN).splitlines()
    assert max(map(len, lines), default=0) <= width
    letters = "".join("".join(lines).split())
    for row in rows[1:]:
        for cell in row:
            for word in unmarked(cell).split():
                assert word in letters


def test_json_is_one_document_and_what_it_cannot_say_is_null(capsys: pytest.CaptureFixture[str]) -> None:
    show_json({"a_m": float("nan"), "b": [1.5, float("inf")], "c": "µ"})
    out = capsys.readouterr().out
    assert json.loads(out) == {"a_m": None, "b": [1.5, None], "c": "µ"}
    assert "µ" in out
