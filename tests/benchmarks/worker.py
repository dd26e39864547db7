"""A process that measures: it has one build of the positioner, stays on one core, and plays one case at a time.

    python -m benchmarks.worker CORE

It reads the name of a case from a line of its input and answers with one line of JSON. The first time, it prepares the
case, plays it once to warm up, and answers with its labels; each later time, it plays the case and answers with the
durations and results. So several builds, and other programs, can take turns on one core.
"""

from __future__ import annotations

import gc
import json
import sys
from typing import TYPE_CHECKING

from benchmarks import machine
from benchmarks.cases import cycle_cases, peer_cases, plan_cases

if TYPE_CHECKING:
    from benchmarks.case import Case


def main() -> None:
    """Serve until the input ends."""
    all_cases = {**cycle_cases(), **plan_cases(), **peer_cases()}
    prepared: dict[str, Case] = {}
    machine.be_quiet(int(sys.argv[1]))
    _answer({"build": machine.build(), "versions": machine.versions()})
    for line in sys.stdin:
        name = line.strip()
        if name not in prepared:
            case = prepared[name] = all_cases[name]()
            case.play()
            machine.be_quiet(int(sys.argv[1]))
            _answer({"labels": case.labels})
        else:
            gc.collect()
            played = prepared[name].play()
            _answer({"durations_ns": played.durations_ns, "result": played.result})


def _answer(document: object) -> None:
    sys.stdout.write(json.dumps(document) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
