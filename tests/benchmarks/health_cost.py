"""What the health of the valve adds to a cycle: `PYTHONPATH=tests python -m benchmarks.health_cost`.

A recorded run of the paper's valve is played again and again, each cycle followed by the daemon's part for health. The
least time of each cycle counts, and the least time of its health, which stand side by side by the mode of the cycle.
"""

from __future__ import annotations

import gc
import logging
import sys
from time import perf_counter_ns
from typing import TYPE_CHECKING, Any, cast

from benchmarks.cycles import CycleCase, scenario
from benchmarks.distribution import smallest
from benchmarks.valves import _NoWriter
from positioner.bench.inprocess import configure
from positioner.cycle.step import step
from positioner.runtime.valve_health import ValveHealth

if TYPE_CHECKING:
    from positioner.config.schema import Configuration
    from positioner.machine.journal import Log
    from positioner.runtime.learned_table import LearnedTable

_REPEATS, _SETPOINTS, _SEED = 10, 3, 3
_DWELLS_S = (0.12, 0.5)
"""Eight moves a second, and two."""


class _NoTable:
    """In the place of the daemon's stiction table."""

    writer = _NoWriter()
    health: dict[str, Any] = {}  # noqa: RUF012 - nobody changes it

    def take_replaced_health(self) -> None:
        pass


def main() -> None:
    """Print what a cycle takes, and what health adds, for both dwells."""
    gc.disable()
    for dwell_s in _DWELLS_S:
        wanted = scenario(1e-3, _SETPOINTS, dwell_s, _SEED)
        case, configuration = CycleCase(wanted), configure(wanted)
        played = [_played(case, configuration) for _ in range(_REPEATS)]
        timer_ns = min(_timer_ns() for _ in range(1000))
        steps_ns, healths_ns = ([least - timer_ns for least in smallest([each[i] for each in played])] for i in (0, 1))
        sys.stdout.write(f"a move each {dwell_s:g} s:\n")
        for label in ("all", *dict.fromkeys(case.labels)):
            chosen = [i for i, own in enumerate(case.labels) if label in ("all", own)]
            step_us, health_us = (sum(part[i] for i in chosen) / len(chosen) * 1e-3 for part in (steps_ns, healths_ns))
            share = 100.0 * health_us / step_us
            sys.stdout.write(
                f"  {label}, {len(chosen)} cycles: step {step_us:.1f} us, health {health_us:.2f} us: {share:.2f} %\n"
            )


def _played(case: CycleCase, configuration: Configuration) -> tuple[list[int], list[int]]:
    """Return the durations in ns of all cycles, and of their health."""
    health = ValveHealth(configuration, cast("LearnedTable", _NoTable()), cast("Log", logging.getLogger("none")))
    setup, state, inputs = case.start()
    steps_ns, healths_ns = [0] * len(inputs), [0] * len(inputs)
    now = perf_counter_ns
    for index, cycle_input in enumerate(inputs):
        before, began = state, now()
        state, outbox, events = step(setup, before, cycle_input)
        done = now()
        health.cycle(cycle_input, before, state, outbox, events)
        healths_ns[index], steps_ns[index] = now() - done, done - began
    return steps_ns, healths_ns


def _timer_ns() -> int:
    began = perf_counter_ns()
    return perf_counter_ns() - began


if __name__ == "__main__":
    main()
