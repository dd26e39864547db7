"""A step response test on an emulated valve in memory, with the true positions beside it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import tomli_w

from plant_emulator import valve
from plant_emulator.presets import plant_settings
from positioner.commissioning.closed_loop import ClosedLoop
from positioner.commissioning.procedure import ProcedureLimits
from positioner.commissioning.step.hold import HoldLaw
from positioner.commissioning.step.memory import Doing, StepMemory
from positioner.commissioning.step.plan import Plan
from positioner.commissioning.step.procedure import StepTest
from positioner.config.reader import parse_config
from positioner.laws.law import Observation
from positioner.values import replace
from positioner.valve.credible import Limits

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

CLEAN: dict[str, float] = {"noise_of_reading": 0.0, "noise_of_span": 0.0}
LOW: dict[str, float] = {"noise_of_reading": 0.0, "noise_of_span": 0.0005}
HIGH: dict[str, float] = {"noise_of_reading": 0.02, "noise_of_span": 0.0}
STARTS_M = {"paper": 0.075, "graphite": 0.015}


def make_test(preset: str, sensor: dict[str, float], law: str, period_s: float = 0.001, **plan: Any) -> StepTest:
    """Return the test of the configured valve `preset`, with other fields of its plan."""
    tables = {
        "valve": {"id": "FV-101", "preset": preset},
        "control": {"law": "nmpc" if law == "hold" else law, "sample_period_s": period_s},
        "estimator": sensor,
    }
    configuration = parse_config(tomli_w.dumps(tables), "test", Path())
    known = configuration.valve
    limits = ProcedureLimits.of(known, configuration.guard)
    chosen = HoldLaw(known.travel_min_m, known.span_m) if law == "hold" else configuration.make_law()
    loop = ClosedLoop(chosen, Limits(configuration.valve), configuration.control.table_cell_m)
    return StepTest(known, limits, period_s, replace(Plan.of(known, limits, is_open=law == "hold"), **plan), loop)


@dataclass
class Played:
    """A test that was played: its memory, the true position at each sample, and where levels were asked for."""

    test: StepTest
    memory: StepMemory
    true_m: NDArray[np.float64]
    asked: list[tuple[int, StepMemory]]
    """Each sample at which a new level was asked for, with the memory then."""

    def true_steps(self) -> list[tuple[float, float, NDArray[np.float64]]]:
        """Return of each response its true rest before, its true rest after, and the true positions from the step."""
        count = round(self.test.plan.wait_s / self.test.period_s)
        starts = [sample for sample, memory in self.asked if memory.doing is Doing.STEPS]
        before, group = 3 if self.test.plan.is_open else 1, 2 * self.test.plan.repeats
        steps = []
        for number, sample in enumerate(starts):
            if number % (before + group) >= before:
                after = self.true_m[sample : sample + count]
                before_m = float(self.true_m[sample - count // 4 : sample].mean())
                steps.append((before_m, float(after[-(count // 4) :].mean()), after))
        assert len(steps) == len(self.memory.responses)
        return steps


def play(
    test: StepTest,
    preset: str,
    sensor: dict[str, float],
    seed: int = 5,
    each: Callable[[StepTest, StepMemory, int], StepMemory] = lambda _test, memory, _number: memory,
    **plant: Any,
) -> Played:
    """Play the test to its end; `each` may change the memory before each cycle."""
    start = {"initial_position_m": STARTS_M[preset], **plant.pop("valve", {})}
    settings = plant_settings(preset, {"sensor": sensor, "valve": start, **plant})
    state, measured_m = valve.measure(settings, valve.initial_state(settings, seed))
    memory = test.begin(measured_m)
    applied_ma, number = memory.current_ma, 0
    true_m: list[float] = []
    asked: list[tuple[int, StepMemory]] = []
    low_ma, high_ma = test.limits.current_low_ma, test.limits.current_high_ma
    while not memory.ended:
        before, memory = memory, each(test, memory, number)
        observation = Observation(measured_m, applied_ma, test.period_s, measured_m, number * test.period_s)
        memory, asked_ma = test.advance(memory, observation)
        if memory.level != before.level:
            asked.append((number, memory))
        true_m.append(state.stem.position_m)
        applied_ma = min(max(asked_ma, low_ma), high_ma)
        state, measured_m = valve.measure(settings, valve.step(settings, state, applied_ma, test.period_s))
        number += 1
    return Played(test, memory, np.array(true_m), asked)
