"""The texts that tests in kernels and packages look for are those that the product prints; to see it needs neither."""

from __future__ import annotations

import ast
from pathlib import Path

import printed
import pytest

from positioner.doctor.finding import Finding, Level, summary

FOLDER = Path(__file__).resolve().parents[1]
TESTS = [*sorted((FOLDER / "kernel").glob("test_*.py")), FOLDER / "debian" / "test_real_packages.py"]
"""CI plays those of the image's layout."""
READING = frozenset({"logged", "count"})
"""Methods that look for their argument in what a program printed."""
NO_TEXTS = frozenset(
    {"{", "fv101.toml", "char-ttyACM", "entry", "all", "100 800007ff"}
    | {"STEM_POSITION", "Position_mm", "STEM_POSITION(", "PLANT_TRUTH("}
)
"""Not the product's words: JSON, files, tables of the kernel, names of the DBC in cantools' output."""


def literals(source: str) -> list[str]:
    """Return the strings that a test looks for in what was printed, and that stand in the test itself."""
    found: list[ast.expr] = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Compare) and isinstance(node.ops[0], ast.In | ast.NotIn):
            found.append(node.left)
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in READING:
            found += node.args
    return [each.value for each in found if isinstance(each, ast.Constant) and isinstance(each.value, str)]


def test_a_text_that_is_printed_no_more_is_told_with_the_line_that_is() -> None:
    with pytest.raises(ValueError, match="look for ' 0 FAIL', and the product prints '0 FAIL, 0 WARN, 1 OK'"):
        printed.of(summary([Finding(Level.OK, "bus", "is up")]), text=" 0 FAIL")


def test_an_examination_in_which_something_fails_does_not_look_like_one_in_which_nothing_does() -> None:
    assert summary([]).startswith(printed.NOTHING_FAILS)
    for failures in (1, 10):
        assert not summary([Finding(Level.FAIL, "bus", "is down")] * failures).startswith(printed.NOTHING_FAILS)


@pytest.mark.parametrize("path", TESTS, ids=[path.stem for path in TESTS])
def test_what_such_a_test_looks_for_stands_in_one_place(path: Path) -> None:
    assert set(literals(path.read_text(encoding="utf-8"))) - NO_TEXTS == set()
