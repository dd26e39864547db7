"""The page of the acceptance figures: each runner has its section, and says whether its goals are met."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import pytest
import results_page
from results_page import PAGE, Runner, main, page_of, played, runners, sections_of, source_of
from slow_cases import OTHER_CASES

if TYPE_CHECKING:
    from pathlib import Path

NAMES = tuple(each.name for each in runners())


def test_every_section_of_the_page_has_a_runner_and_names_its_command() -> None:
    sections = sections_of(PAGE.read_text(encoding="utf-8"))
    assert {"signature", "explain", "setpoint functions"} <= set(sections) <= set(NAMES)
    for runner in runners():
        if runner.name in sections:
            assert f"`PYTHONPATH=tests python {' '.join(runner.command)}" in sections[runner.name]


def test_a_section_is_replaced_in_its_place_and_one_without_a_runner_goes() -> None:
    page = page_of({"b": "## b\n\nold\n", "gone": "## gone\n", "a": "## a\n\nfirst\n"}, ("a", "b"))
    sections = sections_of(page)
    assert list(sections) == ["a", "b"]
    assert page_of({**sections, "b": "## b\n\nnew\n"}, ("a", "b")) == page.replace("old", "new")


@pytest.mark.parametrize(("status", "words"), [(0, "all goals met ("), (1, "**not all goals met** (")])
def test_a_section_tells_whether_the_goals_are_met(tmp_path: Path, status: int, words: str) -> None:
    runner = tmp_path / "acceptance_x.py"
    runner.write_text(f"import sys\nprint('| a | b |', sys.argv[1:])\nsys.exit({status})\n", encoding="utf-8")
    section, met = played(Runner("x", "What it shows.", (str(runner),)), ["--short"], "commit abc")
    assert met is (status == 0)
    assert words in section
    assert "What it shows.\n\n| a | b | ['--short']\n" in section


@pytest.mark.parametrize(
    ("compiled", "build_of", "told"),
    [
        ("False", "", "commit abc1234"),
        ("True", "base", "compiled build of commit abc1234"),
        ("True", "", "name its commit with --build-of"),
        ("False", "base", "no compiled build"),
        ("True", "gone", "no such commit"),
    ],
)
def test_the_page_names_a_commit_that_can_be_checked_out(
    monkeypatch: pytest.MonkeyPatch, compiled: str, build_of: str, told: str
) -> None:
    def answer(command: list[str], _environment: dict[str, str] | None = None) -> str:
        if command[0] != "git":
            return compiled
        return "" if "gone" in command[-1] else "abc1234"

    monkeypatch.setattr(results_page, "_told", answer)
    if "abc1234" in told:
        assert source_of(build_of) == told
    else:
        with pytest.raises(ValueError, match=told):
            source_of(build_of)


def test_an_unknown_section_is_refused_with_the_known_ones(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["results_page", "--only", "nothing"])
    with pytest.raises(SystemExit):
        main()
    assert f"known: {', '.join(NAMES)}" in capsys.readouterr().err


_LONG = {"identify", "counters"}
_SHORT_FORMS = [
    pytest.param(each.name, marks=[pytest.mark.slow(short=OTHER_CASES)] if each.name in _LONG else [])
    for each in runners()
    if each.prints_table
]


@pytest.mark.parametrize("name", _SHORT_FORMS)
def test_the_short_form_of_a_runner_meets_its_goals(name: str) -> None:
    runner = next(each for each in results_page.runners() if each.name == name)
    section, met = played(runner, ["--short"], "this source")
    assert met, section
