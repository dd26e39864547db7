"""Damaged and hostile files for every reader: each is read, or refused with one clear line, and quickly.

    PYTHONPATH=tests python -m endurance.fuzz_files [--share 0.01] [--seed 1] [--keep DIR] [--kinds health,result]

Each input is a true file that was changed at random, with words of its format. A reader may take it, or refuse it with
an error of the project's own. Any other exception, more than a second of the processor, more than 256 MiB, or a file
that was changed outside the state directory is a violation: it is named with its seed, and kept in DIR.
"""

from __future__ import annotations

import argparse
import logging
import os
import resource
import signal
import sys
import tempfile
import time
import warnings
from collections import Counter
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING

from tqdm import tqdm

from endurance.file_kinds import KINDS, FileKind
from positioner.errors import PositionerError

if TYPE_CHECKING:
    from types import FrameType

MOST_CPU_S, MOST_MIB = 1.0, 256
_ENDLESS_S = 20.0
_LONGEST_INSERT = 1 << 16
_LONGEST_LINE = 2000
_CHUNK = 250
_MEMORY = "/dev/shm"  # noqa: S108 - a name below it is unguessable; what is kept is synced, and a disk takes long for it


@dataclass
class Findings:
    """The findings of a run, by kind of file; a violation names the kind, the seed of the input and what happened."""

    inputs: Counter[str] = field(default_factory=Counter)
    taken: Counter[str] = field(default_factory=Counter)
    violations: list[str] = field(default_factory=list)
    longest_s: float = 0.0
    peak_mib: float = 0.0

    def add(self, other: Findings) -> None:
        """Add the findings of a part of the run."""
        self.inputs += other.inputs
        self.taken += other.taken
        self.violations += other.violations
        self.longest_s = max(self.longest_s, other.longest_s)
        self.peak_mib = max(self.peak_mib, other.peak_mib)

    def lines(self) -> list[str]:
        """Return the findings for the reader."""
        by_kind = ", ".join(f"{name} {count} ({self.taken[name]} taken)" for name, count in sorted(self.inputs.items()))
        return [
            f"{sum(self.inputs.values())} inputs: {by_kind}",
            f"longest {self.longest_s:.2f} s of processor, peak {self.peak_mib:.0f} MiB",
            f"{len(self.violations)} violation(s)",
            *self.violations,
        ]


def changed(true: bytes, other: bytes, words: tuple[bytes, ...], chance: Random) -> bytes:
    """Return a changed copy of the file `true`: bits, spans and words are changed, removed, doubled or inserted."""
    data = bytearray(true)
    for _ in range(chance.choice((1, 1, 2, 3, 8))):
        at = chance.randrange(len(data) + 1)
        span = min(chance.choice((1, 2, 8, 64)), len(data) - at)
        match chance.randrange(8):
            case 0 if span:
                data[at] ^= 1 << chance.randrange(8)
            case 1:
                del data[at : at + span]
            case 2:
                data[at:at] = data[at : at + span]
            case 3:
                data[at:at] = chance.choice(words)
            case 4:
                data[at : at + span] = chance.choice(words)
            case 5:
                word = chance.choice(words)
                data[at:at] = word * min(chance.choice((2, 40, 3000)), _LONGEST_INSERT // len(word))
            case 6:
                start = chance.randrange(len(other) + 1)
                data[at : at + span] = other[start : start + chance.choice((4, 32, 400))]
            case _:
                del data[at:]
    return bytes(data)


class EndlessError(BaseException):
    """Reading does not end; no reader's own `except Exception` catches it."""


def _give_up(number: int, frame: FrameType | None) -> None:
    del number, frame
    raise EndlessError


def try_one(kind: FileKind, seed: int, folder: Path) -> tuple[bytes, bool, str, float]:
    """Return one input, whether it was accepted, the error in words (or empty), and the processor time in s."""
    chance = Random(f"{kind.name} {seed}")  # noqa: S311 - a test needs the same numbers again
    number = chance.randrange(len(kind.true))
    data = changed(kind.true[number], chance.choice(kind.true), kind.words, chance)
    taken, wrong = False, ""
    began_s = time.process_time()
    signal.signal(signal.SIGVTALRM, _give_up)
    signal.setitimer(signal.ITIMER_VIRTUAL, _ENDLESS_S)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            kind.read(number, data, folder)
        taken = True
    except PositionerError as error:
        lines = str(error).splitlines()
        if not lines or max(map(len, lines)) > _LONGEST_LINE:
            wrong = f"{len(lines)} lines of up to {max(map(len, lines), default=0)} characters"
    except MemoryError:
        wrong = "out of memory"
    except EndlessError:
        wrong = f"not read after {_ENDLESS_S:.0f} s"
    except Exception as error:  # noqa: BLE001 - the fuzz looks for these
        wrong = f"{type(error).__name__}: {str(error)[:200]!r}"
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
    spent_s = time.process_time() - began_s
    if not wrong and spent_s > MOST_CPU_S:
        wrong = f"{spent_s:.2f} s"
    return data, taken, wrong, spent_s


def run_part(name: str, seeds: range, keep: str) -> Findings:
    """Return the findings of the inputs with these seeds."""
    kind, found = KINDS[name], Findings()
    with tempfile.TemporaryDirectory(dir=_MEMORY if os.access(_MEMORY, os.W_OK) else None) as place:
        folder = Path(place) / "state"
        folder.mkdir()
        for seed in seeds:
            data, taken, wrong, spent_s = try_one(kind, seed, folder)
            found.inputs[name] += 1
            found.taken[name] += taken
            found.longest_s = max(found.longest_s, spent_s)
            beside = [path.name for path in Path(place).iterdir() if path != folder]
            wrong = wrong or (f"touched {beside}" if beside else "")
            if wrong:
                found.violations.append(f"{name} {seed}: {wrong}")
                if keep:
                    (Path(keep) / f"{name}-{seed}").write_bytes(data)
    found.peak_mib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    if found.peak_mib > MOST_MIB:
        found.violations.append(f"{name} {seeds}: {found.peak_mib:.0f} MiB")
    return found


def fuzz(share: float, seed: int, keep: str = "", jobs: int | None = None, kinds: str = "") -> Findings:
    """Return the findings of `share` of the full number of inputs of some kinds, or of all; 1 means all inputs."""
    found = Findings()
    parts = [
        (kind.name, range(start, min(start + _CHUNK, end)))
        for kind in KINDS.values()
        if not kinds or kind.name in kinds.split(",")
        for end in (seed + max(1, round(share * kind.inputs)),)
        for start in range(seed, end, _CHUNK)
    ]
    with (
        ProcessPoolExecutor(jobs or os.cpu_count()) as pool,
        tqdm(total=sum(len(seeds) for _, seeds in parts), unit=" inputs", leave=False, disable=None) as bar,
    ):
        for done in as_completed([pool.submit(run_part, name, seeds, keep) for name, seeds in parts]):
            part = done.result()
            found.add(part)
            bar.update(sum(part.inputs.values()))
    return found


def main() -> int:
    """Run; 0 when nothing was found."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0] if __doc__ else "")
    parser.add_argument("--share", type=float, default=1.0, help="of the full number of inputs (%(default)s)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kinds", default=",".join(KINDS), help="kinds of file (%(default)s)")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes (%(default)s)")
    parser.add_argument("--keep", default="", metavar="DIR", help="where inputs that lead to a violation are kept")
    arguments = parser.parse_args()
    for library in ("can", "cantools"):  # as in our commands: their log lines would be gigabytes here
        logging.getLogger(library).setLevel(logging.CRITICAL)
    if arguments.keep:
        Path(arguments.keep).mkdir(parents=True, exist_ok=True)
    found = fuzz(arguments.share, arguments.seed, arguments.keep, arguments.jobs, arguments.kinds)
    sys.stdout.write("\n".join(found.lines()) + "\n")
    return 1 if found.violations else 0


if __name__ == "__main__":
    sys.exit(main())
