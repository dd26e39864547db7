"""Lets every kind of system call of a daemon fail or wait, one occasion a run, and checks how the daemon reacts.

    PYTHONPATH=tests:tests/kernel python -m endurance.syscall_faults [--short] [--only CALL] [--jobs N]

For each call that a start and a thousand cycles make after the first line of our own code: its first 5 occasions and 20
at random. A daemon may be silent for 3 periods, or fail safe and log it, or, before it is ready, end with one line
and a documented status. Exit status: 0 nothing else happened, 1 something did, 2 there is no strace.
"""

from __future__ import annotations

import argparse
import os
import random
import re
import shutil
import sys
import tempfile
from collections import Counter
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path

from harness.packages import CannotFetchError, unpacked
from tqdm import tqdm

from endurance.struck_daemon import WAIT, Outcome, Run, Strike

CYCLES = 1000
FIRST, AT_RANDOM = 5, 20
ERRORS = ("ENOMEM", "EIO", "ENOSPC", "EMFILE")
_MEMORY = frozenset({"mmap", "mprotect", "munmap", "mbind", "mremap", "madvise"})
"""Calls that can fail only because memory is short."""
_SURE = frozenset(
    {"brk", "futex", "getrandom", "uname", "getpid", "gettid", "geteuid", "getuid", "getgid", "getegid", "getppid"}
    | {"sched_getaffinity", "sched_getscheduler", "rt_sigaction", "rt_sigprocmask", "wait4", "kill", "clock_nanosleep"}
    | {"getsockname", "lseek", "umask", "alarm", "prlimit64"}
)
"""Calls that no shortage lets fail (man 2 ...; brk returns the old break): they can only be slow."""
_ENDS = frozenset({"exit", "exit_group", "rt_sigreturn", "execve"})
"""Calls that cannot fail, or that are made once, before our own code."""
_CALL = re.compile(r"^(\w+)\(")
_CACHE = Path(__file__).resolve().parents[2] / "build" / "strace"


def find_strace() -> list[str]:
    """Return the command for strace: this machine's, or one from its package, unpacked beside the tests' kernels.

    Raises:
        CannotFetchError: there is none.
    """
    if found := shutil.which("strace"):
        return [found]
    root = unpacked(_CACHE, ("strace",))
    libraries = ":".join(str(path) for path in (*root.glob("usr/lib/*-linux-gnu"), root / "usr/lib"))
    return ["env", f"LD_LIBRARY_PATH={libraries}", str(root / "usr/bin/strace")]


def occasions(trace: str) -> dict[str, range]:
    """Return for each call of a complete trace its occasions, counted from 1, after the first line of our own code."""
    before: Counter[str] = Counter()
    after: Counter[str] = Counter()
    counted, loading = before, False
    for line in trace.splitlines():
        if (call := _CALL.match(line)) and call[1] not in _ENDS:
            counted[call[1]] += 1
            loading = loading or "positioner/__pycache__/start." in line or "positioner/start.py" in line
            if loading and call[1] == "close":  # the interpreter has read it, and runs it now
                counted = after
    return {call: range(before[call] + 1, before[call] + count + 1) for call, count in sorted(after.items())}


def planned(found: dict[str, range], chance: random.Random, *, short: bool) -> list[Strike]:
    """Return the strikes: at each occasion one fault, all of them in turn; in the short form one of each call."""
    strikes = []
    for number, (call, numbers) in enumerate(found.items()):
        faults = (WAIT,) if call in _SURE else ("ENOMEM", WAIT) if call in _MEMORY else (*ERRORS, WAIT)
        first = numbers[:FIRST]
        rest = numbers[FIRST:]
        chosen = [*first, *sorted(chance.sample(rest, min(AT_RANDOM, len(rest))))]
        if short:
            chosen = chosen[-1:] if call not in _SURE else []
        strikes += [Strike(call, each, faults[(number + index) % len(faults)]) for index, each in enumerate(chosen)]
    return strikes


def count(folder: Path, strace: list[str], cycles: int) -> dict[str, range]:
    """Return the occasions of an undisturbed run.

    Raises:
        RuntimeError: the undisturbed run fails.
    """
    outcome = Run(folder, strace, ["--trace=all", "--string-limit=256"]).play(cycles)
    if outcome.fault or outcome.what != "went on":
        raise RuntimeError(f"undisturbed, the daemon {outcome.what}: {outcome.fault}")
    return occasions((folder / "strace").read_text(encoding="utf-8", errors="replace"))


def main(arguments: list[str] | None = None) -> int:
    """Run; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--short", action="store_true", help="a hundred cycles, one occasion of a call")
    parser.add_argument("--cycles", type=int, metavar="N", help="instead of 1000, or of 100")
    parser.add_argument("--only", metavar="CALL", help="this system call only")
    parser.add_argument("--seed", type=int, default=1, help="of the occasions at random (%(default)s)")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="daemons at once (%(default)s)")
    options = parser.parse_args(arguments)
    try:
        strace = find_strace()
    except CannotFetchError as error:
        sys.stderr.write(f"syscall_faults: {error}\n")
        return 2
    cycles = options.cycles or (CYCLES // 10 if options.short else CYCLES)
    with tempfile.TemporaryDirectory(prefix="syscalls-") as name:
        folder = Path(name)
        found = count(folder / "undisturbed", strace, cycles)
        found = {call: numbers for call, numbers in found.items() if options.only in {None, call}}
        strikes = planned(found, random.Random(options.seed), short=options.short)  # noqa: S311 - no secret
        sys.stdout.write(f"{len(found)} system calls: {', '.join(f'{call} {len(n)}' for call, n in found.items())}\n")
        outcomes = _strike(folder, strace, strikes, cycles, options.jobs)
    faults = {strike: outcome for strike, outcome in outcomes.items() if outcome.fault}
    counts = Counter(outcome.what for outcome in outcomes.values() if outcome.struck)
    missed = sum(not outcome.struck for outcome in outcomes.values())
    summary = ", ".join(f"{what} {count}" for what, count in sorted(counts.items()))
    sys.stdout.write(f"{len(outcomes)} runs, {missed} not struck, {len(faults)} wrong; {summary}\n")
    for strike, outcome in faults.items():
        sys.stdout.write(f"wrong: {strike}: {outcome.what}: {outcome.fault}\n")
    return int(bool(faults))


def _strike(folder: Path, strace: list[str], strikes: list[Strike], cycles: int, jobs: int) -> dict[Strike, Outcome]:
    outcomes = {}
    with ThreadPoolExecutor(jobs) as pool:
        futures = {
            pool.submit(_one, folder / str(number), strace, strike, cycles): strike
            for number, strike in enumerate(strikes)
        }
        for future in tqdm(as_completed(futures), total=len(futures), unit="run", disable=None):
            strike = futures[future]
            outcomes[strike] = future.result()
            if outcomes[strike].fault:
                tqdm.write(f"{strike}: {outcomes[strike].fault}", file=sys.stdout)
    return dict(sorted(outcomes.items(), key=lambda item: strikes.index(item[0])))


def _one(folder: Path, strace: list[str], strike: Strike, cycles: int) -> Outcome:
    outcome = Run(folder, strace, strike.options()).play(cycles)
    if not outcome.fault:
        shutil.rmtree(folder)
    return outcome


if __name__ == "__main__":
    sys.exit(main())
