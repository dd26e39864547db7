"""The process that valgrind runs: it plays a recorded run, and has the instructions of each cycle counted.

valgrind --tool=callgrind --instr-atstart=no python -m benchmarks.counted_cycles
"""

from __future__ import annotations

import gc

from benchmarks.callgrind import Callgrind
from benchmarks.cycles import CycleCase, scenario
from positioner.cycle.step import step

EMPTY = "nothing"
"""The label of what the counting itself takes."""
_SETPOINTS, _DWELL_S, _SEED = 3, 0.6, 3


def main() -> None:
    """Play the run twice without counting, so that the interpreter has adapted itself, then once with it."""
    callgrind = Callgrind()
    case = CycleCase(scenario(1e-3, _SETPOINTS, _DWELL_S, _SEED))
    gc.collect()
    gc.disable()
    case.play()
    case.play()
    setup, state, inputs = case.start()
    callgrind.start()
    callgrind.zero()
    callgrind.dump(EMPTY.encode())
    callgrind.zero()
    callgrind.dump(EMPTY.encode())
    for cycle_input, label, passes in zip(inputs, case.labels, case.passes, strict=True):
        text = f"{label}, {passes} passes".encode()
        callgrind.zero()
        state, _, _ = step(setup, state, cycle_input)
        callgrind.dump(text)


if __name__ == "__main__":
    main()
