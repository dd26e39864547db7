"""What the health of the valve adds to a cycle: `PYTHONPATH=tests python -m benchmarks.health_cost`.

A recorded run of the paper's valve, mostly at rest, is given to the daemon's part for health again and again; the least
time counts, beside the least time of `step` for the same cycles.
"""

from __future__ import annotations

import gc
import logging
import sys
from time import perf_counter_ns
from typing import TYPE_CHECKING, Any, cast

from benchmarks.cycles import initial_state, scenario
from benchmarks.valves import _NoWriter
from plant_emulator.device import advance, initial_device, publish, take
from positioner.bench.inprocess import configure
from positioner.bench.playable import check_playable
from positioner.cycle.input import CycleInput
from positioner.cycle.step import step
from positioner.runtime.valve_health import ValveHealth
from positioner.wire.messages import Setpoint

if TYPE_CHECKING:
    from positioner.machine.journal import Log
    from positioner.runtime.learned_table import LearnedTable

_NS = 1_000_000_000
_REPEATS, _SETPOINTS, _DWELL_S, _SEED = 20, 6, 0.12, 3


class _NoTable:
    """In the place of the daemon's stiction table."""

    writer = _NoWriter()
    health: dict[str, Any] = {}  # noqa: RUF012 - nobody changes it

    def take_replaced_health(self) -> None:
        pass


def main() -> None:
    """Print what a cycle takes, and what health adds."""
    wanted = scenario(1e-3, _SETPOINTS, _DWELL_S, _SEED)
    configuration = configure(wanted)
    settings, setup = check_playable(wanted, configuration), configuration.make_setup()
    state, device, cycles, steps_ns = initial_state(configuration), initial_device(settings, _SEED), [], 0
    gc.disable()
    for sample in range(round(wanted.duration_s / wanted.sample_period_s)):
        inbox = []
        if sample % wanted.samples_per_setpoint == 0:
            inbox.append(setup.codec.encode(Setpoint(wanted.setpoint_m_at(sample)), sample % 256))
        device, published = publish(setup.codec, settings, device)
        cycle_input = CycleInput((*inbox, *published), round((sample + 1) * wanted.sample_period_s * _NS))
        before, begin_ns = state, perf_counter_ns()
        state, outbox, events = step(setup, before, cycle_input)
        steps_ns += perf_counter_ns() - begin_ns
        device = advance(settings, take(setup.codec, device, outbox), wanted.sample_period_s)
        cycles.append((cycle_input, before, state, outbox, events))
    least_ns = min(_observed_ns(configuration, cycles) for _ in range(_REPEATS))
    each_us, step_us = least_ns / len(cycles) * 1e-3, steps_ns / len(cycles) * 1e-3
    share = 100.0 * each_us / step_us
    sys.stdout.write(f"health {each_us:.2f} us of a cycle, step {step_us:.0f} us: {share:.1f} % more\n")


def _observed_ns(configuration: Any, cycles: list[Any]) -> int:
    health = ValveHealth(configuration, cast("LearnedTable", _NoTable()), cast("Log", logging.getLogger("none")))
    begin_ns = perf_counter_ns()
    for cycle in cycles:
        health.cycle(*cycle)
    return perf_counter_ns() - begin_ns


if __name__ == "__main__":
    main()
