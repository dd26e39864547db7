"""Every acceptance figure of commissioning and diagnostics, on one page: `make diagnostics-test`.

Each `tests/*/acceptance_*.py`, and `loop_acceptance.py` beside this file, plays emulated valves whose faults are known,
and prints its goals, its figures and whether they are met; `--short` plays a few. Goals that a test holds are played by
pytest. A section of the page is replaced when its runner has run. With a compiled build on PYTHONPATH, `--build-of`
names its commit.
"""

from __future__ import annotations

import argparse
import ast
import os
import re
import subprocess
import sys
import time
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "commissioning-results.md"
HEAD = """\
# Commissioning and diagnostics: goals and figures

On emulated valves whose parameters and faults are known; no procedure and no diagnosis reads them. Noise is 0.05 % of
the span where nothing else is said. `make diagnostics-test` plays everything and writes this page;
`make diagnostics-test ARGS="--only signature"` plays one section anew, and `ARGS=--short` a few valves of each.
"""


@dataclass(frozen=True)
class Runner:
    """One section of the page: its name, what it shows, and the arguments of its command after `python`."""

    name: str
    about: str
    command: tuple[str, ...]
    prints_table: bool = True

    @property
    def folder(self) -> Path:
        """Where a program finds its neighbours."""
        return (ROOT / self.command[-1]).parent


TESTED = (
    Runner(
        "explain",
        "Every command of a bench is explained, and the explanation agrees with the trace.",
        ("-m", "pytest", "-q", "tests/diagnostics/test_explain.py"),
        prints_table=False,
    ),
    Runner(
        "setpoint functions",
        "Monotone, inverse to each other, no jump but at the cut-offs; with all off, every command is as without them.",
        ("-m", "pytest", "-q", "tests/setpoint"),
        prints_table=False,
    ),
)


def runners() -> tuple[Runner, ...]:
    """Return the sections, in the order of the page."""
    files = [*sorted((ROOT / "tests").glob("*/acceptance_*.py")), ROOT / "tests" / "diagnostics" / "loop_acceptance.py"]
    found = []
    for path in files:
        paragraphs = (ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or "").split("\n\n")[1:]
        about = "\n\n".join(each for each in paragraphs if not each.startswith(" "))
        name = path.stem.removeprefix("acceptance_").removesuffix("_acceptance")
        found.append(Runner(name.replace("_", " "), about, (str(path.relative_to(ROOT)),)))
    return (*found, *TESTED)


def played(runner: Runner, more: list[str], source: str) -> tuple[str, bool]:
    """Return the section of a runner, and whether its goals are met; `source` says what was played."""
    arguments = [*runner.command, *(more if runner.prints_table else [])]
    begin_s = time.monotonic()
    done = subprocess.run(
        [sys.executable, *arguments],
        stdout=subprocess.PIPE,
        text=True,
        cwd=ROOT,
        check=False,
        env=_environment(runner.folder),
    )
    lines = [line.rstrip() for line in done.stdout.splitlines()]
    output = "\n".join(
        lines if runner.prints_table else [line for line in lines if " passed" in line or "failed" in line]
    )
    met = done.returncode == 0
    command = " ".join(("PYTHONPATH=tests python", *arguments))
    minutes = (time.monotonic() - begin_s) / 60.0
    when = datetime.now(UTC).strftime("%Y-%m-%d")
    verdict = "all goals met" if met else "**not all goals met**"
    tail = f"`{command}`: {verdict} ({when}, {source}, {minutes:.1f} min)"
    return f"## {runner.name}\n\n{runner.about.strip()}\n\n{output.strip()}\n\n{tail}\n", met


def _environment(*folders: Path) -> dict[str, str]:
    """Return the environment in which modules of the tests are found, also with PYTHONSAFEPATH."""
    given = os.environ.get("PYTHONPATH")  # a compiled build may be given
    paths = [str(ROOT / "tests"), *map(str, folders), *([given] if given else [])]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}


def source_of(build_of: str) -> str:
    """Return which source is played: this commit, or the compiled build of a commit of this history.

    Raises:
        ValueError: a compiled build is played and not named, or the other way round, or the commit is not known.
    """
    asks = "from positioner.machine.build import is_compiled; print(is_compiled())"
    is_compiled = _told([sys.executable, "-c", asks], _environment()) == "True"
    if is_compiled != bool(build_of):
        told = "a compiled build: name its commit with --build-of" if is_compiled else "no compiled build"
        raise ValueError(f"PYTHONPATH leads to {told}")
    commit = _told(["git", "rev-parse", "--short", "--verify", f"{build_of or 'HEAD'}^{{commit}}"])
    if not commit:
        raise ValueError(f"--build-of {build_of}: no such commit")
    return f"compiled build of commit {commit}" if build_of else f"commit {commit}"


def _told(command: list[str], environment: dict[str, str] | None = None) -> str:
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False, env=environment)
    return done.stdout.strip()


def sections_of(text: str) -> dict[str, str]:
    """Return the sections of a page by their names."""
    parts = re.split(r"^(?=## )", text, flags=re.MULTILINE)[1:]
    return {part.partition("\n")[0].removeprefix("## ").strip(): f"{part.strip()}\n" for part in parts}


def page_of(sections: dict[str, str], order: tuple[str, ...]) -> str:
    """Return the page with its sections in order; a section without a runner goes."""
    return "\n".join([HEAD, *(sections[name] for name in order if name in sections)])


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--short", action="store_true", help="a few valves of each runner; the page stays as it is")
    parser.add_argument("--only", action="append", default=[], metavar="NAME", help="this section only")
    parser.add_argument("--page", type=Path, default=PAGE, help="the page to write (default: %(default)s)")
    parser.add_argument("--build-of", default="", metavar="COMMIT", help="commit of the compiled build on PYTHONPATH")
    arguments = parser.parse_args()
    every = runners()
    names = tuple(each.name for each in every)
    for name in arguments.only:
        if name not in names:
            parser.error(f"--only {name}: no such section; known: {', '.join(names)}")
    try:
        source = source_of(arguments.build_of)
    except ValueError as error:
        parser.error(str(error))
    all_met = True
    for runner in every:
        if arguments.only and runner.name not in arguments.only:
            continue
        section, met = played(runner, ["--short"] if arguments.short else [], source)
        all_met = all_met and met
        sys.stdout.write(f"{section}\n")
        sys.stdout.flush()
        if not arguments.short:
            before = arguments.page.read_text(encoding="utf-8") if arguments.page.exists() else ""
            sections = {**sections_of(before), runner.name: section}
            arguments.page.write_text(page_of(sections, names), encoding="utf-8")
    return 0 if all_met else 1


if __name__ == "__main__":
    sys.exit(main())
