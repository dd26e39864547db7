"""Removes every reaction of SAFETY.md's table, one at a time, and checks that the named test fails.

    PYTHONPATH=.:tests python -m endurance.reactions [--only F2] [--jobs N]

First all named tests pass on the tree as it is. Then, for each removal, a copy of the tree without the reaction runs
its test. A removal is noticed when a test fails by what it asserts: an error in a fixture, a missing name
or a timeout proves nothing. Exit status: 0 all are noticed, 1 some are not, 2 the table itself is wrong.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

from tqdm import tqdm

from endurance.removals import ROOT, Removal, read_removals

_PARTS = ("positioner", "plant_emulator", "tests", "dbc", "systemd", "docs", "pyproject.toml", "Makefile")
_TIMEOUT_S = 600.0
_TESTS_PER_TIMEOUT = 20
"""A test of the table takes some seconds, a few take a minute: 30 s for each is far above their mean."""
_BROKEN = ("NameError", "UnboundLocalError", "SyntaxError", "ImportError", "ModuleNotFoundError", "IndentationError")


@dataclass(frozen=True, slots=True)
class Verdict:
    """The outcome of a run of pytest: `noticed` when a test failed by what it asserts; `why` in a few words."""

    noticed: bool
    passed: bool
    why: str
    elapsed_s: float


def copy_tree(source: Path, target: Path) -> None:
    """Copy what the tests need from one tree to another."""
    for name in (*_PARTS, *(page.name for page in source.glob("*.md"))):
        part = source / name
        if part.is_dir():
            shutil.copytree(part, target / name, ignore=shutil.ignore_patterns(".*"))
        elif part.exists():
            shutil.copy2(part, target / name)


def run_tests(tree: Path, tests: list[str], workers: int = 0) -> Verdict:
    """Run the tests on the tree, and on nothing else of the project; with 0 workers in one process."""
    report = tree / "report.xml"
    paths = os.pathsep.join((str(tree), str(tree / "tests")))
    options = ["-q", "-p", "no:cacheprovider", f"--numprocesses={workers}", f"--junitxml={report}"]
    command = [sys.executable, "-m", "pytest", *options, *tests]
    limit_s = _TIMEOUT_S * (1 + len(tests) // _TESTS_PER_TIMEOUT)
    start_s = time.monotonic()
    try:
        done = subprocess.run(
            command,
            cwd=tree,
            env={**os.environ, "PYTHONPATH": paths, "PYTHONDONTWRITEBYTECODE": ""},
            capture_output=True,
            text=True,
            timeout=limit_s,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return Verdict(noticed=False, passed=False, why="hangs", elapsed_s=limit_s)
    elapsed_s = time.monotonic() - start_s
    if done.returncode != 1:
        passed = done.returncode == 0
        last = (done.stdout.strip() or done.stderr.strip() or "nothing was said").splitlines()[-1]
        why = "passes" if passed else f"pytest ends with {done.returncode}: {last}"
        return Verdict(noticed=False, passed=passed, why=why, elapsed_s=elapsed_s)
    noticed, why = assess(report.read_text(encoding="utf-8"))
    return Verdict(noticed=noticed, passed=False, why=why, elapsed_s=elapsed_s)


def assess(report: str) -> tuple[bool, str]:
    """Return whether a test of a JUnit report failed by what it asserts, and why in a few words."""
    cases = list(ET.fromstring(report).iter("testcase"))  # noqa: S314 - pytest wrote it
    errors = [_report(case, "error") for case in cases if case.find("error") is not None]
    failures = [_report(case, "failure") for case in cases if case.find("failure") is not None]
    broken = [each for each in failures if each.message.startswith(_BROKEN)]
    if errors:
        return False, f"error, not a failure: {errors[0]}"
    if broken:
        return False, f"the removal breaks the code: {broken[0]}"
    return bool(failures), str(failures[0]) if failures else "no test failed"


@dataclass(frozen=True, slots=True)
class _Report:
    """One test of a JUnit report."""

    test: str
    message: str

    def __str__(self) -> str:
        return f"{self.test}: {_first_line(self.message)}" if self.test else _first_line(self.message)


def _report(case: ET.Element, kind: str) -> _Report:
    found = case.find(kind)
    return _Report(case.get("name", ""), "" if found is None else found.get("message", ""))


def check(whole: Path, removal: Removal) -> Verdict:
    """Take one reaction away in a copy of the whole tree, and run its test there."""
    with tempfile.TemporaryDirectory(prefix="reaction-") as name:
        tree = Path(name)
        copy_tree(whole, tree)
        path = tree / removal.file
        path.write_text(removal.apply(path.read_text(encoding="utf-8")), encoding="utf-8")
        for compiled in (path.parent / "__pycache__").glob(f"{path.stem}.*"):
            compiled.unlink()
        return run_tests(tree, [removal.test])


def main(arguments: list[str] | None = None) -> int:
    """Run; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", metavar="ROW", help="this row of the table only")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="runs at once (%(default)s)")
    options = parser.parse_args(arguments)
    try:
        removals = [removal for removal in read_removals() if options.only in {None, removal.row}]
        for removal in removals:
            removal.apply((ROOT / removal.file).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        sys.stderr.write(f"reactions.toml: {error}\n")
        return 2
    if not removals:
        sys.stderr.write(f"reactions.toml: no removal for the row {options.only}\n")
        return 2
    with tempfile.TemporaryDirectory(prefix="reaction-") as name:
        whole = Path(name)  # so that no edit meanwhile changes what is tested
        copy_tree(ROOT, whole)
        sys.stderr.write("the named tests on the tree as it is ...\n")
        verdict = run_tests(whole, sorted({removal.test for removal in removals}), options.jobs)
        if not verdict.passed:
            sys.stderr.write(f"the tests do not pass on the tree as it is: {verdict.why}\n")
            return 2
        verdicts = _check_all(whole, removals, options.jobs)
    unseen = [removal for removal in removals if not verdicts[removal].noticed]
    rows = len({removal.row for removal in removals})
    sys.stdout.write(f"{len(removals)} removals for {rows} rows, {len(unseen)} not noticed\n")
    for removal in unseen:
        sys.stdout.write(f"not noticed: {_line(removal, verdicts[removal])}\n")
    return int(bool(unseen))


def _check_all(whole: Path, removals: list[Removal], jobs: int) -> dict[Removal, Verdict]:
    verdicts = {}
    with ThreadPoolExecutor(jobs) as pool:
        futures = {pool.submit(check, whole, removal): removal for removal in removals}
        for future in tqdm(as_completed(futures), total=len(futures), unit="removal", disable=None):
            removal = futures[future]
            verdicts[removal] = future.result()
            tqdm.write(_line(removal, verdicts[removal]), file=sys.stdout)
    return verdicts


def _line(removal: Removal, verdict: Verdict) -> str:
    word = "noticed" if verdict.noticed else "UNSEEN "
    return f"{removal.row:4} {word} {verdict.elapsed_s:5.1f} s  {removal.file}  {verdict.why}"


def _first_line(message: str) -> str:
    lines = message.strip().splitlines()
    return lines[0][:100] if lines else "nothing was said"


if __name__ == "__main__":
    sys.exit(main())
