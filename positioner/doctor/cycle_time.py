"""How long a cycle takes on this machine: a short closed loop in memory, from frames to frames, is timed. Shell.

The valve is the law's own model of it, with the noise of its sensor, so that the law does what it does at a real valve:
it averages, pushes, stops the stem. The processor time counts, so that other programs do not; what bus, log and trace
add is not measured.
"""

from __future__ import annotations

import gc
import math
import random
import shlex
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from positioner.config.reader import parse_config
from positioner.cycle.input import CycleInput
from positioner.cycle.state import CycleState
from positioner.cycle.step import step
from positioner.doctor.finding import Finding, Level
from positioner.inputs.durations import duration
from positioner.laws.registry import is_outside
from positioner.machine.build import is_compiled
from positioner.reach.case import Case
from positioner.valve.actuator import ActuatorParameters
from positioner.valve.rollout import Moving
from positioner.valve.state import StemState
from positioner.valve.stiction import StictionTable
from positioner.wire.messages import CurrentCommand, Quality, Setpoint, StemPosition

if TYPE_CHECKING:
    from collections.abc import Iterator

    from positioner.config.schema import Configuration

CYCLES, LONGEST_S = 1200, 1.0
"""So many cycles are timed, or fewer where they take longer than this together."""
_FEWEST, FIRST = 300, 60
"""At least so many are timed, after the first ones, in which Python and the solver do what they do only once."""
_EVERY, _MOVE_OF_SPAN = 150, 0.05
"""A setpoint by so much away comes after so many cycles."""
_SHARE = 0.8
"""The part of a period that a cycle may take, but for one of a hundred: bus, log and trace need the rest."""
_LEAST_S = 1e-6
"""No cycle is so short: a clock that does not move within 99 of 100 cycles says 0."""
_LAG_S = 0.05
"""The lag that is tried for a valve that has none."""
_ANY_VALVE = '[valve]\nid = "any"\npreset = "paper"\n[control]\nsample_period_s = 0.001\n'
_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class CycleTime:
    """Processor times of `cycles` cycles in s: the median, the one that 99 of 100 do not exceed, and the longest."""

    median_s: float
    p99_s: float
    longest_s: float
    cycles: int

    @property
    def shortest_period_s(self) -> float:
        """The shortest sample period that these cycles fit in, rounded up to two digits."""
        period_s = max(self.p99_s, _LEAST_S) / _SHARE
        digit_s = 10.0 ** (math.floor(math.log10(period_s)) - 1)
        return math.ceil(period_s / digit_s) * digit_s

    def in_words(self) -> str:
        """Return the durations and the period in one line."""
        return (
            f"{duration(self.median_s, 2)} in the median, {duration(self.p99_s, 2)} for 99 % of {self.cycles} cycles, "
            f"{duration(self.longest_s, 2)} the longest; "
            f"the shortest period for it is {duration(self.shortest_period_s, 2)}"
        )


def findings(configuration: Configuration, path: Path) -> Iterator[Finding]:
    """Yield how long a cycle takes, and whether the configured period is long enough; then as `with_other_lag`."""
    if is_outside(configuration.control.law):
        text = f"not measured: law {configuration.control.law} is a plug-in, and the doctor runs no code of others"
        yield Finding(Level.OK, "cycle", text)
        return
    measured, period_s = measure(configuration), configuration.control.sample_period_s
    found = _finding(configuration, measured)
    if measured.p99_s > _SHARE * period_s:
        fix = f"positioner reach --config {shlex.quote(str(path))}  # what a longer control.sample_period_s reaches"
        if not is_compiled():
            fix = (
                "sudo apt install gcc python3-dev  # then install the positioner again, not as editable: it is compiled"
            )
        text = f"{found.text}, and the configured one of {duration(period_s, 2)} is too short"
        found = Finding(Level.WARN, found.subject, text, fix)
    yield found
    yield from _of_other_lag(configuration)


def of_any_valve() -> Iterator[Finding]:
    """Yield how long a cycle of `nmpc` takes at 1 kHz, without lag and with one."""
    configuration = parse_config(_ANY_VALVE, "doctor", Path())
    yield _finding(configuration, measure(configuration))
    yield from _of_other_lag(configuration)


def _of_other_lag(configuration: Configuration) -> Iterator[Finding]:
    """Yield the same for a valve without the lag of this one, or with a lag where it has none."""
    if configuration.control.law == "nmpc":
        other = _with_other_lag(configuration)
        yield _finding(other, measure(other))


def _finding(configuration: Configuration, measured: CycleTime) -> Finding:
    law, valve = configuration.control.law, configuration.valve
    if law == "nmpc":
        lags = "sensor lag or backlash" if valve.actuator.is_immediate else valve.actuator.in_words()
        law += " without lag" if valve.is_immediate else f" with {lags}"
    build = "compiled" if is_compiled() else "interpreted"
    return Finding(Level.OK, "cycle", f"{law}, {build}: {measured.in_words()}")


def measure(configuration: Configuration) -> CycleTime:
    """Return how long the cycles of this configuration take."""
    setup = configuration.make_setup()
    setup = replace(setup, guard=replace(setup.guard, auto_arm=True))
    codec, stem, noise = setup.codec, _Stem(Case.of(configuration)), random.Random(1)  # noqa: S311 - a sensor's noise
    state = CycleState(table=StictionTable(cell_width_m=configuration.control.table_cell_m))
    echo, durations_ns, spent_ns = 0, list[int](), 0
    was_on = gc.isenabled()
    gc.disable()
    try:
        for cycle in range(FIRST + CYCLES):
            asked_m = stem.middle_m + (_MOVE_OF_SPAN * setup.valve.span_m if cycle // _EVERY % 2 else 0.0)
            reading = StemPosition(stem.x + noise.gauss(0.0, stem.sigma_m), echo, Quality.VALID)
            frames = (codec.encode(Setpoint(asked_m), cycle), codec.encode(reading, cycle))
            cycle_input = CycleInput(frames, round((cycle + 1) * setup.period_s * _NS))
            before_ns = time.thread_time_ns()
            state, outbox, _ = step(setup, state, cycle_input)
            taken_ns = time.thread_time_ns() - before_ns
            for message, counter in map(codec.decode, outbox):
                if isinstance(message, CurrentCommand):
                    echo = counter or 0
                    stem.move(message.current_ma)
            if cycle >= FIRST:
                durations_ns.append(taken_ns)
                spent_ns += taken_ns
                if spent_ns > LONGEST_S * _NS and len(durations_ns) >= _FEWEST:
                    break
    finally:
        if was_on:
            gc.enable()
    durations_ns.sort()
    count = len(durations_ns)
    median_ns, p99_ns = durations_ns[count // 2], durations_ns[math.ceil(0.99 * count) - 1]
    return CycleTime(median_ns / _NS, p99_ns / _NS, durations_ns[-1] / _NS, count)


class _Stem:
    """The stem of the law's model, in whole sample periods."""

    def __init__(self, case: Case) -> None:
        self._rollout, self.middle_m, self.sigma_m = case.rollout(), case.middle_m, case.sigma_m
        pressure = self._rollout.pressure.at_rest(self._rollout.numbers.balance_ma(self.middle_m))
        self._moving = Moving(pressure, StemState(self.middle_m, 0.0, True, 1.0))

    @property
    def x(self) -> float:
        """Where the stem is, in m."""
        return self._moving.stem.position_m

    def move(self, current_ma: float) -> None:
        """Let a period pass under this current."""
        self._moving = self._rollout.after(self._moving, current_ma)


def _with_other_lag(configuration: Configuration) -> Configuration:
    """Return the configuration without lag where there is one, else with one."""
    actuator = ActuatorParameters()
    if configuration.valve.is_immediate:
        actuator = replace(actuator, fill_time_constant_s=_LAG_S, vent_time_constant_s=_LAG_S)
    valve = replace(configuration.valve, actuator=actuator, sensor_time_constant_s=0.0, backlash_m=0.0)
    return replace(configuration, valve=valve)
