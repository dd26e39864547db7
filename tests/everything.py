"""Plays everything that CI leaves out, part by part, and prints one table: what failed, what it told, how long it took.

    PYTHONPATH=tests python -m everything [--only NAME ...] [--resume] [--publish | --left-out]

A part that fails stops no other one. Its output is in out/everything/NAME.log, the results of all parts in
out/everything/results.json: a run of some parts replaces their rows, and leaves the others. Exit status: 0 each chosen
part has passed, 1 one has not.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.machine import processor

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

ROOT = Path(__file__).resolve().parents[1]
OUT = ROOT / "out" / "everything"
PAGE = ROOT / "docs" / "tests.md"
MARKED = re.compile(r"(<!-- make test-all -->\n).*(<!-- end of make test-all -->)", re.DOTALL)
_LONGEST_S = 7200.0
"""A part that takes longer hangs: the longest one takes a sixth of it on two cores."""
_LONGEST_TOLD = 100
"""Characters of what a part told."""
_SUMMARY = re.compile(
    r"^=* ?((?:\d+ (?:passed|failed|errors?|skipped|deselected|xfailed|warnings?)(?:, )?)+) in ", re.MULTILINE
)
"""The last line of a run of pytest."""
_OUTER = frozenset({"PYTHONPATH", "MAKEFLAGS", "MAKELEVEL", "MFLAGS"})
"""What this program has from its own `make`, and a part must not have."""
_COLOURS = re.compile(r"\x1b\[[0-9;]*m")


@dataclass(frozen=True, slots=True)
class Part:
    """One command, how many seconds it takes on two cores, and what it plays.

    short: what CI plays in its place, targets of the Makefile or files below `tests`. tells: what stands in the line
    that sums the run up; empty for a run of pytest. beside: it mostly waits for kernels or clocks, so it is played
    beside the others. fetches: it needs what the first part fetches.
    """

    name: str
    command: str
    about_s: int
    plays: str
    short: str = ""
    tells: str = ""
    beside: bool = False
    fetches: bool = False


@dataclass(frozen=True, slots=True)
class Result:
    """What became of a part, at which commit; `+` behind it stands for changes that are not committed."""

    passed: bool
    told: str
    elapsed_s: float
    commit: str
    date: str


_RUN = "PYTHONPATH=.:tests:tests/kernel $PYTHON -m"
PARTS = (
    Part(
        "tools",
        "apt-get install --quiet --yes chromium fonts-dejavu-core mmdebstrap skopeo umoci"
        " && $PYTHON -m pip install --quiet --editable '.[fmu,fuzz,mutants]' && $PYTHON -m mutmut --version",
        60,
        "fetches a browser, the tools that make an image, atheris, FMPy and mutmut",
    ),
    Part(
        "kernel", "make test-kernel", 1200, "all tests in kernels of their own", "make test-kernel-short", beside=True
    ),
    Part(
        "soak",
        f"{_RUN} endurance.soak --seconds 300 --growth 0.02",
        330,
        "five minutes in real time of an hour",
        "endurance/test_endurance_soak.py",
        tells="violations:",
        beside=True,
    ),
    Part("slow", "make test-slow", 420, "the tests marked `slow`", "make test"),
    Part(
        "compiled",
        "make test-compiled",
        420,
        "all tests of the compiled rooms; a bench to the bit",
        "make test-compiled-short",
    ),
    Part(
        "fmu",
        "make test-fmu",
        30,
        "a plant out of an FMU, built and played",
        "plant_emulator/test_own_physics.py",
        fetches=True,
    ),
    Part("browser", "make test-browser", 60, "report and monitor in a headless browser", "make test-browser"),
    Part(
        "packages",
        "make test-packages",
        300,
        "the Debian package and the image, built, installed and used",
        "make test-packages-short, packages/test_deb.py",
    ),
    Part(
        "reactions",
        f"{_RUN} endurance.reactions",
        600,
        "each reaction of SAFETY.md, taken away, is missed by its test",
        "endurance/test_reactions.py",
        tells="not noticed",
    ),
    Part(
        "mutants",
        f"rm -rf mutants; {_RUN} endurance.mutants",
        300,
        "each change of the guarded modules is noticed by a test",
        "make coverage",
        tells="escaped",
        fetches=True,
    ),
    Part(
        "fuzz",
        f"{_RUN} endurance.fuzz --frames 200000",
        20,
        "200,000 hostile frames of 1.3 million",
        "endurance/test_fuzz.py",
        tells="none taken that",
    ),
    Part(
        "decoder",
        f"{_RUN} endurance.fuzz_decoder -runs=300000",
        60,
        "the decoder under a fuzzer, 300,000 of 3 million inputs",
        "wire/test_wire_codec.py",
        tells="stat::number_of_executed_units",
        fetches=True,
    ),
    Part(
        "fuzz-files",
        f"{_RUN} endurance.fuzz_files --share 0.05",
        100,
        "one damaged file of 20",
        "endurance/test_fuzz_files.py",
        tells="inputs",
    ),
    Part(
        "faults",
        f"{_RUN} endurance.faults --moves 5 --plants paper",
        150,
        "5 moves of 100 with each fault",
        "endurance/test_endurance_faults.py",
        tells="false alarms",
    ),
    Part(
        "stall",
        f"{_RUN} endurance.stalls --virtual 1000 --real 10",
        100,
        "2,010 stalls of 20,200",
        "endurance/test_endurance_stall.py",
        tells="violations:",
    ),
    Part(
        "crash",
        f"{_RUN} endurance.crash --kills 400 --daemon-kills 8 --damage-share 0.03",
        120,
        "408 kills of 10,200, and 3 % of the damaged files",
        "endurance/test_endurance_crash.py",
        tells="violations",
    ),
    Part(
        "restart",
        f"{_RUN} endurance.restarts --short",
        20,
        "21 restarts of 1,008",
        "endurance/test_endurance_restarts.py",
        tells="restarts,",
    ),
    Part(
        "leak",
        f"{_RUN} endurance.leak --short",
        30,
        "a fiftieth of the cycles",
        "endurance/test_endurance_leak.py",
        tells="garbage",
    ),
    Part(
        "syscall",
        f"{_RUN} endurance.syscall_faults --short",
        90,
        "each system call once",
        "endurance/test_endurance_syscalls.py",
        tells="wrong;",
    ),
    Part(
        "long-replay",
        f"{_RUN} endurance.long_replay --frames 200000",
        60,
        "a log of a fifth",
        "replay/test_replay_long.py",
        tells="bytes a frame",
    ),
)
"""In the order of the table; the tools come first, since a kernel must not see the environment change."""


def told_by(part: Part, output: str) -> str:
    """Return what a part told: how many tests passed and failed in all its runs of pytest, or the line that sums up."""
    output = _COLOURS.sub("", output)
    counts: dict[str, int] = {}
    for summary in _SUMMARY.findall(output):
        for count, word in re.findall(r"(\d+) (\w+)", summary):
            counts[word] = counts.get(word, 0) + int(count)
    if counts and not part.tells:
        return ", ".join(f"{counts[word]} {word}" for word in ("passed", "failed", "error", "errors") if word in counts)
    lines = [line.strip() for line in re.split(r"[\r\n]+", output) if line.strip()]
    fitting = [line for line in lines if part.tells in line] or lines
    return fitting[-1][:_LONGEST_TOLD] if fitting else ""


def play(part: Part, folder: Path, commit: str, environment: dict[str, str], longest_s: float = _LONGEST_S) -> Result:
    """Play a part, with its output in a file of `folder`."""
    began_s = time.monotonic()
    log = folder / f"{part.name}.log"
    with log.open("wb") as output:
        process = subprocess.Popen(
            ["sh", "-c", part.command],
            cwd=ROOT,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        try:
            status, why = process.wait(longest_s), ""
        except subprocess.TimeoutExpired:
            status, why = 1, f"not over after {longest_s:g} s; "
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
    told = why + told_by(part, log.read_text(encoding="utf-8", errors="replace"))
    date = datetime.now(UTC).strftime("%Y-%m-%d")
    return Result(status == 0, told, time.monotonic() - began_s, commit, date)


def play_all(
    parts: Sequence[Part],
    one: Callable[[Part], Result],
    note: Callable[[str], None],
    keep: Callable[[str, Result], None],
) -> bool:
    """Play the parts, those that mostly wait beside the others; return whether all passed.

    one: plays a part. note: prints a line. keep: keeps the result of the part with this name.
    """
    begun = iter(range(1, len(parts) + 1))

    def lane(some: Iterable[Part]) -> bool:
        all_passed = True
        for part in some:
            note(f"[{next(begun)}/{len(parts)}] {part.name}: about {part.about_s} s; {part.plays}")
            result = one(part)
            keep(part.name, result)
            note(f"{part.name}: {_verdict(result)} in {result.elapsed_s:.0f} s; {result.told}")
            all_passed = all_passed and result.passed
        return all_passed

    first = lane(part for part in parts if part is PARTS[0])
    rest = [part for part in parts if part is not PARTS[0]]
    with ThreadPoolExecutor(1) as pool:
        waiting = pool.submit(lane, [part for part in rest if part.beside])
        working = lane([part for part in rest if not part.beside])
        return all((first, waiting.result(), working))


def table(results: dict[str, Result], parts: Sequence[Part] = PARTS) -> str:
    """Return the table of all parts, in Markdown."""
    rows = ["| part | plays | result | told | s | commit |", "|---|---|---|---|---|---|"]
    for part in parts:
        result = results.get(part.name)
        if result is None:
            rows.append(f"| {part.name} | {part.plays} | not played | | | |")
            continue
        told, verdict = result.told.replace("|", "/"), _verdict(result)
        verdict = verdict if result.passed else f"**{verdict}**"
        at = f"{result.commit}, {result.date}"
        rows.append(f"| {part.name} | {part.plays} | {verdict} | {told} | {result.elapsed_s:.0f} | {at} |")
    return "\n".join([f"{processor()}, Python {sys.version.partition(' ')[0]}.", "", *rows])


def left_out(parts: Sequence[Part] = PARTS) -> str:
    """Return a line for each part that CI does not play whole: what it would check, and what stands for it."""
    lines = ["left out, for `make test-all`; behind each, what stands for it here"]
    lines += [
        f"  {part.name}: {part.plays}: {part.short}" for part in parts if part.short and part.short != part.command
    ]
    return "\n".join(lines)


def published(page: str, text: str) -> str:
    """Return the page with this text between its two marks.

    Raises:
        ValueError: the page does not have them.
    """
    after, count = MARKED.subn(lambda found: f"{found[1]}\n{text}\n\n{found[2]}", page)
    if count != 1:
        raise ValueError("the page has no place for the table: two marks, `make test-all` and its end")
    return after


def chosen(only: Sequence[str], *, resume: bool, results: dict[str, Result], commit: str) -> list[Part]:
    """Return the parts to be played.

    resume: without those that passed at this very commit.

    Raises:
        ValueError: there is no part of such a name.
    """
    names = [part.name for part in PARTS]
    for name in only:
        if name not in names:
            raise ValueError(f"there is no part {name!r}; the parts are {', '.join(names)}")
    done = {name for name, result in results.items() if resume and result.passed and result.commit == commit}
    wanted = [part for part in PARTS if part.name not in done and (not only or part.name in only)]
    if PARTS[0] not in wanted and PARTS[0].name not in done and any(part.fetches for part in wanted):
        wanted.insert(0, PARTS[0])
    return wanted


def read(path: Path) -> dict[str, Result]:
    """Return the results that are kept, by part."""
    if not path.is_file():
        return {}
    return {name: Result(**each) for name, each in json.loads(path.read_text(encoding="utf-8")).items()}


def present_commit() -> str:
    """Return the commit that is played; with `+` where files differ from it."""
    commit = _git("rev-parse", "--short", "HEAD")
    return f"{commit}+" if _git("status", "--porcelain", "--untracked-files=no") else commit


def _git(*words: str) -> str:
    return subprocess.run(["git", *words], cwd=ROOT, check=True, capture_output=True, text=True).stdout.strip()


def _verdict(result: Result) -> str:
    return "passed" if result.passed else "failed"


def _environment() -> dict[str, str]:
    ours = {name: value for name, value in os.environ.items() if name not in _OUTER}
    return {**ours, "PYTHON": sys.executable}


def _note(line: str) -> None:
    sys.stdout.write(f"{datetime.now(UTC):%H:%M:%S} {line}\n")
    sys.stdout.flush()


def main() -> int:
    """Run it from the command line; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME", help="these parts only")
    parser.add_argument("--resume", action="store_true", help="without the parts that passed at this very commit")
    parser.add_argument("--publish", action="store_true", help="put the last table into docs/tests.md; play nothing")
    parser.add_argument("--left-out", action="store_true", help="say what CI leaves out; play nothing")
    options = parser.parse_args()
    if options.left_out:
        sys.stdout.write(left_out() + "\n")
        return 0
    kept = OUT / "results.json"
    results, commit = read(kept), present_commit()
    if options.publish:
        PAGE.write_text(published(PAGE.read_text(encoding="utf-8"), table(results)), encoding="utf-8")
        return 0
    try:
        parts = chosen(options.only, resume=options.resume, results=results, commit=commit)
    except ValueError as error:
        parser.error(str(error))
    OUT.mkdir(parents=True, exist_ok=True)
    began_s = time.monotonic()

    def keep(name: str, result: Result) -> None:
        results[name] = result
        plain = {each: asdict(one) for each, one in results.items()}
        kept.write_text(json.dumps(plain, indent=1) + "\n", encoding="utf-8")

    all_passed = play_all(parts, lambda part: play(part, OUT, commit, _environment()), _note, keep)
    sys.stdout.write(f"\n{table(results)}\n\n{time.monotonic() - began_s:.0f} s; the output of each: {OUT}\n")
    return 0 if all_passed else 1


if __name__ == "__main__":
    sys.exit(main())
