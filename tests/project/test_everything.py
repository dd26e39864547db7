"""`make test-all`: every part is played and told, whatever becomes of the others."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from typing import TYPE_CHECKING

import everything
import pytest
from everything import PARTS, Part, Result

if TYPE_CHECKING:
    from pathlib import Path

MAKEFILE = (everything.ROOT / "Makefile").read_text(encoding="utf-8")
CI = (everything.ROOT / ".ci" / "run").read_text(encoding="utf-8")
LONG_FORM = {
    "crash-test": "crash",
    "fault-test": "faults",
    "stall-test": "stall",
    "restart-test": "restart",
    "leak-test": "leak",
    "syscall-test": "syscall",
}
"""Targets whose part has another name, because it plays a short form of them."""
NO_TESTS = frozenset(
    {
        "all",
        "bench",
        "check",
        "clean",
        "lock",
        "wheel",
        "dist",
        "install",
        "uninstall",
        "deb",
        "image",
        "man",
        "notebooks",
    }
    | {"accept-instructions", "accept-logs", "accept-robustness", "publish-benchmark", "publish-test-all", "test-all"}
)
MEASUREMENTS = frozenset({"benchmark", "campaign-speed", "identify-acceptance", "diagnostics-test", "robustness"})
"""They write pages of their own; `make test-slow` holds short forms of two, and CI one of the last."""


def result(*, passed: bool = True, commit: str = "abc1234") -> Result:
    return Result(passed=passed, told="3 passed", elapsed_s=2.4, commit=commit, date="2026-11-23")


def played(command: str, folder: Path, longest_s: float = 60.0) -> Result:
    environment = {**os.environ, "PYTHON": sys.executable}
    return everything.play(Part("one", command, 1, "a part"), folder, "abc1234", environment, longest_s)


def test_a_part_that_fails_stops_no_other_one_and_the_whole_has_failed(tmp_path: Path) -> None:
    parts = (
        Part("bad", "echo '= 2 failed, 5 passed in 3.1s ='; exit 1", 1, "fails"),
        Part("good", "echo '4 passed in 0.5s'", 1, "passes"),
        Part("waits", "echo '1 passed in 9.0s'", 1, "waits", beside=True),
    )
    lines: list[str] = []
    kept: dict[str, Result] = {}
    passed = everything.play_all(
        parts,
        lambda part: everything.play(part, tmp_path, "abc1234", dict(os.environ)),
        lines.append,
        kept.__setitem__,
    )
    assert not passed
    assert {name: (each.passed, each.told) for name, each in kept.items()} == {
        "bad": (False, "5 passed, 2 failed"),
        "good": (True, "4 passed"),
        "waits": (True, "1 passed"),
    }
    assert len([line for line in lines if re.match(r"\[\d/3\] ", line)]) == 3
    assert (tmp_path / "bad.log").read_text(encoding="utf-8") == "= 2 failed, 5 passed in 3.1s =\n"


def test_all_have_passed_where_each_has(tmp_path: Path) -> None:
    parts = (Part("a", "true", 1, "passes"), Part("b", "true", 1, "passes", beside=True))
    one = lambda part: everything.play(part, tmp_path, "abc1234", dict(os.environ))  # noqa: E731
    assert everything.play_all(parts, one, lambda _: None, lambda *_: None)


def test_the_tests_of_all_runs_of_a_part_are_counted_and_another_program_is_told_by_its_summary(tmp_path: Path) -> None:
    two = "printf '\\033[32m= 60 passed, 2 skipped in 10.0s (0:00:10) =\\033[0m\\n'; echo '3 passed, 1 error in 1.0s'"
    assert played(two, tmp_path).told == "63 passed, 1 error"
    part = Part("soak", "", 1, "", tells="violations:")
    assert everything.told_by(part, "violations: 0\nlast\n") == "violations: 0"
    assert everything.told_by(part, "Traceback\nOSError: no bus\n") == "OSError: no bus"
    assert everything.told_by(part, "") == ""


def test_a_part_that_hangs_is_ended_with_its_children_and_has_failed(tmp_path: Path) -> None:
    found = played(f"echo begun; sleep 600 & echo $! > {tmp_path}/child; wait", tmp_path, longest_s=1.0)
    assert (found.passed, found.told) == (False, "not over after 1 s; begun")
    child = (tmp_path / "child").read_text(encoding="ascii").strip()
    state = subprocess.run(["ps", "-o", "stat=", "-p", child], capture_output=True, text=True, check=False).stdout
    assert state.strip()[:1] in {"", "Z"}


def test_parts_are_chosen_by_name_and_a_resumed_run_leaves_out_what_has_passed_at_this_commit() -> None:
    results = {"soak": result(), "crash": result(passed=False), "slow": result(commit="0000000")}
    names = [part.name for part in everything.chosen([], resume=True, results=results, commit="abc1234")]
    assert names == [part.name for part in PARTS if part.name != "soak"]
    again = everything.chosen(["soak", "browser"], resume=False, results=results, commit="abc1234")
    assert [part.name for part in again] == ["soak", "browser"]
    with pytest.raises(ValueError, match="there is no part 'soke'; the parts are tools, kernel, soak, "):
        everything.chosen(["soke"], resume=False, results={}, commit="abc1234")


def test_what_a_part_needs_is_fetched_first() -> None:
    fetching = everything.chosen(["mutants"], resume=False, results={}, commit="abc1234")
    assert [part.name for part in fetching] == ["tools", "mutants"]
    fetched = everything.chosen(["mutants"], resume=True, results={"tools": result()}, commit="abc1234")
    assert [part.name for part in fetched] == ["mutants"]


def test_the_table_has_a_row_for_each_part_with_its_seconds_and_its_commit() -> None:
    lines = everything.table({"soak": result(), "crash": result(passed=False)}).splitlines()
    rows = {line.split(" | ")[0].removeprefix("| "): line for line in lines[4:]}
    assert list(rows) == [part.name for part in PARTS]
    assert rows["soak"].endswith("| passed | 3 passed | 2 | abc1234, 2026-11-23 |")
    assert "| **failed** |" in rows["crash"]
    assert rows["browser"].endswith("| not played | | | |")


def test_the_table_is_put_between_the_two_marks_of_the_page() -> None:
    page = everything.PAGE.read_text(encoding="utf-8")
    after = everything.published(page, "TABLE")
    assert "<!-- make test-all -->\n\nTABLE\n\n<!-- end of make test-all -->" in after
    assert everything.published(after, "TABLE") == after
    with pytest.raises(ValueError, match="has no place for the table"):
        everything.published("# A page\n", "TABLE")


def targets(text: str) -> set[str]:
    return {word for line in re.findall(r"\bmake((?: [\w-]+)+)", text) for word in line.split()}


def test_every_target_is_played_by_ci_or_here_or_is_no_test() -> None:
    """A target that is added to the Makefile must be played by somebody."""
    declared = set(re.findall(r"^([a-z][\w-]*)(?:(?: [a-z][\w-]*)*):(?!=)", MAKEFILE, flags=re.MULTILINE))
    declared |= {name for line in re.findall(r"^\.PHONY: (.*)$", MAKEFILE, flags=re.MULTILINE) for name in line.split()}
    here = targets(" ".join(part.command for part in PARTS)) | {part.name for part in PARTS}
    here |= {target for target, name in LONG_FORM.items() if name in here}
    assert declared - targets(CI) - here - NO_TESTS - MEASUREMENTS == set()


def test_ci_says_what_it_leaves_out_and_what_stands_for_it() -> None:
    assert "\nmake left-out\n" in CI
    lines = everything.left_out().splitlines()[1:]
    assert [line.split(":")[0].strip() for line in lines] == [
        part.name for part in PARTS if part.name not in {"tools", "browser"}
    ]
    for line in lines:
        for stands in line.rpartition(": ")[2].split(", "):
            target = stands.removeprefix("make ")
            if target != stands:
                assert target in targets(CI), line
            else:
                assert (everything.ROOT / "tests" / stands).is_file(), line
                assert stands.split("/")[0] not in {"kernel", "browser", "fmu", "debian", "site"}, line


@pytest.mark.parametrize("part", PARTS, ids=[part.name for part in PARTS])
def test_a_part_calls_a_target_of_the_makefile_or_a_program_with_options_that_it_has(part: Part) -> None:
    words = shlex.split(part.command)
    if words[0] == "make":
        assert re.search(rf"^{words[1]}\b[^=]*:", MAKEFILE, flags=re.MULTILINE)
        return
    module = words[words.index("-m") + 1]
    if module.startswith("endurance."):
        source = (everything.ROOT / "tests" / f"{module.replace('.', '/')}.py").read_text(encoding="utf-8")
        for option in (word for word in words if word.startswith("--")):
            assert f'"{option}"' in source
        if part.tells and not part.tells.startswith("stat::"):
            package = [path.read_text(encoding="utf-8") for path in (everything.ROOT / "tests/endurance").glob("*.py")]
            assert any(part.tells in text for text in package)
