"""The closed loop without processes or bus: `cycle.step` and the emulated device exchange frames in memory. Pure.

The frames are equal to those of a lockstep bench, to the bit.
"""

from __future__ import annotations

import gc
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from plant_emulator.device import advance, initial_device, publish, take
from positioner.bench.configure import configuration_text
from positioner.bench.playable import check_playable
from positioner.bench.recording import Recording
from positioner.bus.address import BusAddress
from positioner.config.reader import parse_config
from positioner.cycle.events import Controlled
from positioner.cycle.input import CycleInput
from positioner.cycle.state import CycleState
from positioner.cycle.step import step
from positioner.valve.stiction import StictionTable
from positioner.wire.messages import Setpoint

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from positioner.bench.scenario import Scenario
    from positioner.config.schema import Configuration
    from positioner.cycle.events import Event
    from positioner.laws.law import Law
    from positioner.wire.messages import CanFrame

_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class InProcessRun:
    """The result of a run: the recording, every control cycle, every other event, and the learned table."""

    recording: Recording
    cycles: tuple[Controlled, ...]
    events: tuple[Event, ...]
    table: StictionTable


def configure(scenario: Scenario) -> Configuration:
    """Return the daemon's configuration for `scenario`; its bus and state directory are never used.

    Raises:
        ConfigurationError: the scenario's tables do not make a positioner.
    """
    return parse_config(configuration_text(scenario, BusAddress(), Path("unused")), scenario.name, Path())


def run_in_process(
    scenario: Scenario,
    table: StictionTable | None = None,
    progress: Callable[[int], None] = lambda _samples: None,
    law: Law[Any] | None = None,
    *,
    beyond_reach: bool = False,
) -> InProcessRun:
    """Return the run of `scenario`, starting from `table`; `progress` is called with the number of samples done.

    law: it plays in place of the scenario's. beyond_reach: setpoints that no law can serve are played, too.

    Raises:
        ConfigurationError: the scenario's tables do not make a valve or a positioner, or contradict each other.
    """
    configuration = configure(scenario)
    settings = check_playable(scenario, configuration, beyond_reach=beyond_reach)
    setup = configuration.make_setup(plays=True, law=law)
    delay_s = configuration.control.command_delay_s
    codec, period_s, every = setup.codec, scenario.sample_period_s, scenario.samples_per_setpoint
    state = CycleState(table=table or StictionTable(cell_width_m=configuration.control.table_cell_m))
    device = initial_device(settings, scenario.seed)
    samples = round(scenario.duration_s / period_s)
    recording = Recording(codec, samples, period_s, every, lockstep=True)
    cycles: list[Controlled] = []
    events: list[Event] = []
    with _without_collection():
        for sample in range(samples):
            device, published = publish(codec, settings, device)
            inbox = published if sample % every else (_setpoint(scenario, codec.encode, sample, recording), *published)
            received = (*inbox[:-2], inbox[-1])  # without the truth, which the daemon's port does not receive either
            # the daemon's clock in lockstep: one period with each position frame
            state, outbox, happened = step(setup, state, CycleInput(received, round((sample + 1) * period_s * _NS)))
            recording.add_sample(sample, (*inbox, *outbox))
            if delay_s:
                device = advance(settings, device, delay_s)
            device = advance(settings, take(codec, device, outbox), period_s - delay_s)
            for event in happened:
                if isinstance(event, Controlled):
                    cycles.append(event)
                else:
                    events.append(event)
            progress(sample + 1)
    recording.fill_columns()
    return InProcessRun(recording, tuple(cycles), tuple(events), state.table)


@contextmanager
def _without_collection() -> Iterator[None]:
    """Keep the garbage collector off: a run keeps many objects, in no circle, which it would visit again and again."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


def _setpoint(
    scenario: Scenario, encode: Callable[[Setpoint, int], CanFrame], sample: int, recording: Recording
) -> CanFrame:
    setpoint_m = scenario.setpoint_m_at(sample)
    every = scenario.samples_per_setpoint
    recording.setpoint_m[sample : sample + every] = setpoint_m
    return encode(Setpoint(setpoint_m), sample // every)
