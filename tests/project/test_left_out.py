"""A test that `make test` leaves out has a short form there, which the summary of the run names."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest
from endurance.removals import names_of_tests

pytest_plugins = ("pytester",)
TESTS = Path(__file__).resolve().parents[1]
FILES = {str(path.relative_to(TESTS)): ast.parse(path.read_text("utf-8")) for path in sorted(TESTS.rglob("test_*.py"))}


def is_mark(node: ast.AST) -> bool:
    return isinstance(node, ast.Attribute) and node.attr == "slow" and ast.unparse(node) == "pytest.mark.slow"


def mentions(node: ast.AST) -> int:
    """Return how often `pytest.mark.slow` stands in a piece of source."""
    return sum(map(is_mark, ast.walk(node)))


def short_forms(node: ast.AST) -> list[str]:
    """Return the short form in each mark, in the source's own words."""
    calls = [each for each in ast.walk(node) if isinstance(each, ast.Call) and is_mark(each.func)]
    words = [word.value for call in calls for word in call.keywords if word.arg == "short" and not call.args]
    return [str(word.value) if isinstance(word, ast.Constant) else ast.unparse(word) for word in words]


def is_slow(file: str, test: str) -> bool:
    """Return whether a whole test is left out: it, or its file, has the mark."""
    marked: list[ast.AST] = []
    for node in ast.walk(FILES[file]):
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "pytestmark":
            marked.append(node.value)
        elif isinstance(node, ast.FunctionDef) and node.name == test:
            marked += [each for each in node.decorator_list if "parametrize" not in ast.unparse(each)]
    return any(mentions(each) for each in marked)


def parametrized(tree: ast.AST) -> list[ast.List]:
    """Return the lists of cases of which some are left out."""
    return [
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.List)
        and any(isinstance(each, ast.Starred) and ast.unparse(each).startswith("*slow(") for each in node.elts)
    ]


LEFT_OUT = [(file, short) for file, tree in FILES.items() for short in short_forms(tree) if short != "OTHER_CASES"]


def test_every_mark_names_a_short_form() -> None:
    assert len(LEFT_OUT) > 30
    assert {file: mentions(tree) for file, tree in FILES.items()} == {
        file: len(short_forms(tree)) for file, tree in FILES.items()
    }


@pytest.mark.parametrize(("file", "short"), sorted(set(LEFT_OUT)))
def test_a_short_form_is_a_test_that_is_not_left_out_itself(file: str, short: str) -> None:
    other, _, test = short.rpartition("::") if not short.endswith(".py") else (short, "", "")
    other = other or file
    assert other in FILES
    names = [test] if test else sorted(names_of_tests((TESTS / other).read_text("utf-8")))
    assert set(names) <= names_of_tests((TESTS / other).read_text("utf-8"))
    assert any(not is_slow(other, each) for each in names)


@pytest.mark.parametrize("file", [file for file, tree in FILES.items() if parametrized(tree)])
def test_of_the_cases_of_a_test_some_stay(file: str) -> None:
    for cases in parametrized(FILES[file]):
        assert any(not isinstance(each, ast.Starred) for each in cases.elts)


SAMPLE = """
import pytest
from slow_cases import slow

@pytest.mark.slow(short="test_b")
def test_a():
    pass

@pytest.mark.parametrize("n", [1, *slow(2, 3)])
def test_b(n):
    pass
"""


@pytest.mark.parametrize("workers", [[], ["-n", "2"]], ids=["one process", "workers"])
def test_the_summary_names_what_is_left_out_and_its_short_form(pytester: pytest.Pytester, workers: list[str]) -> None:
    pytester.makeini(f"[pytest]\npythonpath = {TESTS}\nmarkers = slow(short): takes long\n")
    pytester.makeconftest(
        "from left_out import LeftOut\n"
        "def pytest_configure(config):\n"
        "    config.pluginmanager.register(LeftOut(config))\n"
    )
    pytester.makepyfile(test_sample=SAMPLE)
    found = pytester.runpytest_subprocess("-m", "not slow", *workers)
    found.assert_outcomes(passed=1, deselected=0 if workers else 3)
    found.stdout.fnmatch_lines(
        [
            "*left out: 3 slow tests, and what stands for each in this run*",
            "test_sample.py::test_a: test_b",
            "test_sample.py::test_b: its other cases (2 cases)",
        ]
    )
    assert "left out" not in pytester.runpytest_subprocess("-k", "test_b").stdout.str()
