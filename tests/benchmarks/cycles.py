"""The cycles of a closed loop, recorded once with the emulated valve and replayed without it, from frames to frames."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from random import Random
from time import perf_counter_ns
from typing import TYPE_CHECKING, Any

from benchmarks.case import Play
from plant_emulator.device import advance, initial_device, publish, take
from positioner.bench.inprocess import configure
from positioner.bench.playable import check_playable
from positioner.bench.scenario import Scenario
from positioner.cycle.events import Controlled
from positioner.cycle.input import CycleInput
from positioner.cycle.state import CycleState
from positioner.cycle.step import step
from positioner.runtime.warm_up import warm_up
from positioner.studies.real_valves.valves import lag_table
from positioner.valve.stiction import StictionTable
from positioner.wire.messages import Motion, Setpoint

if TYPE_CHECKING:
    from collections.abc import Iterator

    from positioner.config.schema import Configuration
    from positioner.cycle.events import Event
    from positioner.cycle.state import Setup
    from positioner.laws.law import Law
    from positioner.wire.messages import CanFrame

_WINDOW_MM = (73.0, 87.0)
"""Setpoints of the paper's valve from which it can restart in both directions."""
_LABELS = {Motion.REST: "at rest", Motion.MOVE: "in a move", Motion.SETTLE: "settling"}
OTHER = "without control"
"""The label of the first cycles, before the positioner is armed."""


@dataclass(frozen=True, slots=True)
class Cycle:
    """One cycle of a recorded run: its input, the state before and after it, its frames, mode and passes."""

    cycle_input: CycleInput
    before: CycleState
    after: CycleState
    outbox: tuple[CanFrame, ...]
    label: str
    passes: int


def scenario(period_s: float, setpoints: int, dwell_s: float, seed: int, lag_s: float = 0.0) -> Scenario:
    """Return a run of many short dwells on the paper's valve, whose setpoints follow from `seed`.

    A lag `lag_s` of the actuator is told to the law.
    """
    random = Random(seed)  # noqa: S311 - setpoints, not secrets
    return Scenario(
        name="speed",
        title="many moves",
        law="nmpc",
        seed=seed,
        sample_period_s=period_s,
        setpoint_period_s=max(period_s, 1e-3),
        setpoints_mm=tuple(round(random.uniform(*_WINDOW_MM), 1) for _ in range(setpoints)),
        dwell_s=dwell_s,
        plant={"preset": "paper", "actuator": lag_table(lag_s)},
        valve={"actuator": lag_table(lag_s)},
    )


def record(wanted: Scenario, configuration: Configuration, law: Law[Any] | None = None) -> Iterator[Cycle]:
    """Yield every cycle of the closed loop of `wanted`, as `positioner.bench.inprocess` plays it, or with `law`."""
    settings, setup = check_playable(wanted, configuration), configuration.make_setup(law=law)
    state, device = initial_state(configuration), initial_device(settings, wanted.seed)
    for sample in range(round(wanted.duration_s / wanted.sample_period_s)):
        inbox: list[CanFrame] = []
        if sample % wanted.samples_per_setpoint == 0:
            number = sample // wanted.samples_per_setpoint
            inbox.append(setup.codec.encode(Setpoint(wanted.setpoint_m_at(sample)), number))
        device, published = publish(setup.codec, settings, device)
        now_ns = round((sample + 1) * wanted.sample_period_s * 1e9)
        cycle_input = CycleInput((*inbox, *published), now_ns)
        before = state
        state, outbox, events = step(setup, state, cycle_input)
        device = advance(settings, take(setup.codec, device, outbox), wanted.sample_period_s)
        yield Cycle(cycle_input, before, state, outbox, *_kind(events))


def initial_state(configuration: Configuration) -> CycleState:
    """Return the state of a positioner that has just started, with an empty table."""
    return CycleState(table=StictionTable(cell_width_m=configuration.control.table_cell_m))


def _kind(events: tuple[Event, ...]) -> tuple[str, int]:
    for event in events:
        if isinstance(event, Controlled):
            return _LABELS[event.decision.motion], event.decision.passes
    return OTHER, 0


class CycleCase:
    """Every cycle of a run, from frames to frames; the law begins each repeat with a new workspace of its solver."""

    def __init__(self, wanted: Scenario) -> None:
        self._configuration = configure(wanted)
        cycles = list(record(wanted, self._configuration))
        self.labels = tuple(cycle.label for cycle in cycles)
        self.passes = tuple(cycle.passes for cycle in cycles)
        self._inputs = [cycle.cycle_input for cycle in cycles]
        self._result = _digest([cycle.outbox for cycle in cycles])

    def start(self) -> tuple[Setup, CycleState, list[CycleInput]]:
        """Return what a repeat starts from: a setup with a new law, the first state, and the inputs of all cycles.

        Before it, the cycles run that a daemon runs before its first one.
        """
        warm_up(self._configuration)
        return self._configuration.make_setup(), initial_state(self._configuration), self._inputs

    def play(self) -> Play:
        """Return the durations of all cycles, and a digest of their frames.

        Raises:
            RuntimeError: a frame differs from the recorded one: this is no repeat.
        """
        durations_ns, sent = _timed(*self.start())
        result = _digest(sent)
        if result != self._result:
            raise RuntimeError("the replayed cycles sent other frames than the recorded ones")
        return Play(durations_ns, result)


def _timed(setup: Setup, state: CycleState, inputs: list[CycleInput]) -> tuple[list[int], list[tuple[CanFrame, ...]]]:
    """Return the durations in ns, which include the end of the last state, and the frames."""
    durations_ns = [0] * len(inputs)
    sent: list[tuple[CanFrame, ...]] = [()] * len(inputs)
    now = perf_counter_ns
    for index, cycle_input in enumerate(inputs):
        began = now()
        state, outbox, _ = step(setup, state, cycle_input)
        durations_ns[index] = now() - began
        sent[index] = outbox
    return durations_ns, sent


def _digest(sent: list[tuple[CanFrame, ...]]) -> str:
    return hashlib.sha256(repr(sent).encode()).hexdigest()
