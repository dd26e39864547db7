"""The instructions of a cycle by mode, which no noise changes, beside those that were accepted.

    python -m benchmarks.instructions            count, and fail where a mode takes 5 % more or less
    python -m benchmarks.instructions --accept   count, and write instructions.json

Valgrind counts, on a processor of its own without AVX-512. Between two runs the counts differ by less than 0.5 %.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING, Any

from benchmarks import machine
from benchmarks.builds import builds
from benchmarks.counted_cycles import EMPTY
from benchmarks.judgement import HELD, judge

if TYPE_CHECKING:
    from collections.abc import Mapping

REFERENCE = Path(__file__).with_name("instructions.json")
_DUMP = re.compile(r"^desc: Trigger: Client Request: (.*)$", re.MULTILINE)
_SUMMARY = re.compile(r"^summary: (\d+)$", re.MULTILINE)


def main() -> None:
    """Count in every build, and judge or accept; exit status 1 where a count has changed."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.instructions", description=__doc__)
    parser.add_argument("--accept", action="store_true", help="write what is counted into instructions.json")
    options = parser.parse_args()
    reference = json.loads(REFERENCE.read_text(encoding="utf-8")) if REFERENCE.exists() else {}
    if shutil.which("valgrind") is None:
        print("instructions: NOT JUDGED: there is no valgrind (apt-get install valgrind)")  # noqa: T201
        return
    failed, python = False, f"Python {sys.version_info.major}.{sys.version_info.minor}"
    measured = builds()
    for name, environment in measured.items():
        counted, key = count(environment), f"{python}, {name}"
        if options.accept:
            reference[key] = counted
        lines, changed = judge(key, counted, reference.get(key))
        failed |= changed
        print("\n".join(lines))  # noqa: T201
    for key in reference:
        version, name = key.split(", ")
        if version == python and name not in measured:
            print(f"instructions ({key}): NOT JUDGED: this build is not here")  # noqa: T201
    if options.accept:
        REFERENCE.write_text(json.dumps(reference, indent=1, sort_keys=True) + "\n", encoding="utf-8")
    sys.exit(failed)


def _valgrind_version() -> str:
    told = subprocess.run(("valgrind", "--version"), capture_output=True, text=True, check=True).stdout
    return told.strip().removeprefix("valgrind-")


def count(environment: Mapping[str, str]) -> dict[str, Any]:
    """Return the mean instructions of a cycle by mode, and in a move by passes, and what they depend on."""
    with tempfile.TemporaryDirectory() as folder:
        valgrind = ("valgrind", "-q", "--tool=callgrind", "--instr-atstart=no", f"--callgrind-out-file={folder}/out")
        # the same names and hashes in every run, and no second thread
        fixed = {**environment, "PYTHONHASHSEED": "0", "OPENBLAS_NUM_THREADS": "1"}
        subprocess.run((*valgrind, sys.executable, "-m", "benchmarks.counted_cycles"), env=fixed, check=True)
        found: dict[str, list[int]] = {}
        for path in Path(folder).iterdir():
            text = path.read_text(encoding="utf-8")
            trigger, summary = _DUMP.search(text), _SUMMARY.search(text)
            if trigger and summary:
                found.setdefault(trigger[1], []).append(int(summary[1]))
    empty = min(found.pop(EMPTY))
    by_passes = {label: [counted - empty for counted in counts] for label, counts in sorted(found.items())}
    by_mode: dict[str, list[int]] = {}
    for label, counts in by_passes.items():
        by_mode.setdefault(label.partition(",")[0], []).extend(counts)
    return {
        "held": {mode: round(fmean(counts)) for mode, counts in by_mode.items() if mode in HELD},
        "cycles": {label: [len(counts), round(fmean(counts))] for label, counts in by_passes.items()},
        "with": machine.versions() | {"valgrind": _valgrind_version()},
    }


if __name__ == "__main__":
    main()
