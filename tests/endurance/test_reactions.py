"""SAFETY.md's table against the code: every row has reactions to take away, and every test it names exists.

`make reactions` takes them away and checks that the tests fail; this file checks what needs no such run.
"""

from __future__ import annotations

import pytest
import safety_page

from endurance import reactions
from endurance.removals import ROOT, Removal, names_of_tests, read_removals

ROWS = safety_page.read_rows(safety_page.PAGE.read_text(encoding="utf-8"))
REMOVALS = read_removals()


def example(**changed: str) -> Removal:
    values = {"row": "B1", "file": "a.py", "text": "x = 1", "becomes": "x = 2", "test": "tests/test_a.py::test_a"}
    return Removal(**{**values, **changed})


def test_every_row_has_a_name_of_its_own_and_a_removal_for_each_test_that_it_names() -> None:
    assert len({row.name for row in ROWS}) == len(ROWS) > 40
    assert {row.name: set(row.tests) for row in ROWS} == {
        row.name: {removal.test for removal in REMOVALS if removal.row == row.name} for row in ROWS
    }
    assert {removal.row for removal in REMOVALS} == {row.name for row in ROWS}


def test_no_removal_stands_twice() -> None:
    assert len(set(REMOVALS)) == len(REMOVALS)


@pytest.mark.parametrize("removal", REMOVALS, ids=[f"{n}-{each.row}" for n, each in enumerate(REMOVALS)])
def test_what_is_removed_stands_there_once_and_python_remains(removal: Removal) -> None:
    source = (ROOT / removal.file).read_text(encoding="utf-8")
    assert removal.apply(source) != source


@pytest.mark.parametrize("name", sorted({removal.test for removal in REMOVALS}))
def test_a_named_test_exists(name: str) -> None:
    path, _, test = name.partition("::")
    assert test in names_of_tests((ROOT / path).read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    ("removal", "source", "message"),
    [
        (example(), "y = 1\n", "stands 0 times in a.py, not once"),
        (example(), "x = 1\nx = 1\n", "stands 2 times in a.py, not once"),
        (example(becomes="x = 1"), "x = 1\n", "nothing is removed"),
        (example(becomes="x = ("), "x = 1\n", "a.py is no Python any more"),
    ],
)
def test_a_removal_that_removes_nothing_or_breaks_everything_is_refused(
    removal: Removal, source: str, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        removal.apply(source)


def test_a_removal_changes_its_text_and_nothing_else() -> None:
    assert example().apply("a = 0\nx = 1  # one\n") == "a = 0\nx = 2  # one\n"
    assert example(file="a.service", becomes="x = (").apply("x = 1\n") == "x = (\n"


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        ('<testcase><failure message="assert 1 == 2&#10; more"/></testcase>', (True, "assert 1 == 2")),
        ('<testcase><error message="fixture fails"/></testcase>', (False, "error, not a failure: fixture fails")),
        (
            '<testcase><failure message="NameError: name"/></testcase>',
            (False, "the removal breaks the code: NameError: name"),
        ),
        ("<testcase/>", (False, "no test failed")),
    ],
)
def test_only_a_failure_by_what_a_test_asserts_counts(body: str, expected: tuple[bool, str]) -> None:
    assert reactions.assess(f"<testsuites><testsuite>{body}</testsuite></testsuites>") == expected


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("| B1 | cause | detection | reaction | `test_a.py::test_b` |", "6 columns are wanted"),
        ("| B1 | cause | | reaction | soon | `test_a.py::test_b` |", "6 columns are wanted"),
        ("| B1 | cause | detection | reaction | soon | test_b |", "names no"),
    ],
)
def test_a_row_that_says_too_little_is_refused(line: str, message: str) -> None:
    table = "\n".join((f"| {' | '.join(safety_page.COLUMNS)} |", "|---|---|---|---|---|---|", line))
    with pytest.raises(ValueError, match=f"SAFETY.md, line 3: .*{message}"):
        safety_page.read_rows(table)
