"""The loop of `bench/inprocess.py`, in which a test can change the frames on their way."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

from plant_emulator.device import advance, initial_device, publish, take
from plant_emulator.presets import plant_settings
from positioner.bench.inprocess import configure
from positioner.bench.scenario import Scenario
from positioner.cycle.input import CycleInput
from positioner.cycle.state import CycleState
from positioner.cycle.step import step
from positioner.valve.stiction import StictionTable
from positioner.wire.messages import Setpoint

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any

    from positioner.cycle.events import Event
    from positioner.wire.messages import CanFrame, HostRequest

E = TypeVar("E")
_NS = 1_000_000_000


def passed(frames: tuple[CanFrame, ...]) -> tuple[CanFrame, ...]:
    """Return the frames as they are."""
    return frames


class Loop:
    """A positioner and an emulated valve, sample by sample.

    to_plant, to_positioner: functions that change the frames on their way; a test may replace them at any time.
    """

    def __init__(self, law: str = "nmpc", table: StictionTable | None = None, seed: int = 1, **scenario: Any) -> None:
        self.scenario = Scenario(
            name="test", title="test", law=law, seed=seed, setpoints_mm=(80.0,), dwell_s=0.1, **scenario
        )
        self.configuration = configure(self.scenario)
        self.plant = plant_settings(overrides=self.scenario.plant)
        self.setup = self.configuration.make_setup()
        self.codec = self.setup.codec
        self.period_s = self.scenario.sample_period_s
        self.state = CycleState(table=table or StictionTable(cell_width_m=self.configuration.control.table_cell_m))
        self.device = initial_device(self.plant, seed)
        self.sample = 0
        self.events: list[Event] = []
        self.to_plant: Callable[[tuple[CanFrame, ...]], tuple[CanFrame, ...]] = passed
        self.to_positioner: Callable[[tuple[CanFrame, ...]], tuple[CanFrame, ...]] = passed

    @property
    def position_m(self) -> float:
        """The true position of the stem in m."""
        return self.device.plant.stem.position_m

    def run(self, duration_s: float, setpoint_m: float, request: HostRequest | None = None) -> list[Event]:
        """Run for `duration_s` with a setpoint that comes every 10 ms, and return the events."""
        before = len(self.events)
        for _ in range(round(duration_s / self.period_s)):
            frames: list[CanFrame] = []
            every = self.scenario.samples_per_setpoint
            if self.sample % every == 0:
                message = Setpoint(setpoint_m) if request is None else Setpoint(setpoint_m, request)
                frames.append(self.codec.encode(message, self.sample // every))
            self.device, published = publish(self.codec, self.plant, self.device)
            inbox = self.to_positioner((*frames, *published))
            self.sample += 1
            cycle_input = CycleInput(tuple(inbox), round(self.sample * self.period_s * _NS))
            self.state, outbox, events = step(self.setup, self.state, cycle_input)
            self.events += events
            self.device = advance(self.plant, take(self.codec, self.device, self.to_plant(outbox)), self.period_s)
        return self.events[before:]

    def events_of(self, kind: type[E]) -> list[E]:
        """Return the events of one kind."""
        return [event for event in self.events if isinstance(event, kind)]
