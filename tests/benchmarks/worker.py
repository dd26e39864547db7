"""A process that measures: it has one build of the positioner, stays on one core, and plays one case at a time.

    python -m benchmarks.worker CORE

It reads the name of a case from a line of its input and answers with one line of JSON. The first time, it prepares the
case, plays it once to warm up, and answers with its labels; each later time, it plays the case and answers with the
durations and results. So several builds, and other programs, can take turns on one core.
"""

from __future__ import annotations

import gc
import json
import os
import sys
import warnings
from typing import TYPE_CHECKING

from benchmarks import machine
from benchmarks.cases import cases

if TYPE_CHECKING:
    from benchmarks.case import Case


def main() -> None:
    """Serve until the input ends."""
    core = int(sys.argv[1])
    # the other programs warn and print as they like; the answers go where their words do not
    warnings.simplefilter("ignore")
    with os.fdopen(os.dup(1), "w", encoding="utf-8", buffering=1) as answers:
        os.dup2(2, 1)
        known = cases()
        prepared: dict[str, Case] = {}
        answers.write(json.dumps({"build": machine.build(), "versions": machine.versions()}) + "\n")
        for line in sys.stdin:
            name = line.strip()
            if name not in prepared:
                prepared[name] = known[name].make()
                prepared[name].play()
                machine.be_quiet(core)
                answer: dict[str, object] = {"labels": prepared[name].labels}
            else:
                gc.collect()
                played = prepared[name].play()
                answer = {"durations_ns": played.durations_ns, "result": played.result}
            answers.write(json.dumps(answer) + "\n")


if __name__ == "__main__":
    main()
