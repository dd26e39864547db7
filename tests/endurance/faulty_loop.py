"""The closed loop in memory with one fault in it: before the positioner, or between the positioner and the stem."""

from __future__ import annotations

import copy
import math
import random
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from plant_emulator.device import DeviceState, advance, initial_device, publish, take
from plant_emulator.presets import plant_settings
from positioner.bench.inprocess import configure
from positioner.cycle.input import CycleInput
from positioner.cycle.state import CycleState, Setup
from positioner.cycle.step import step
from positioner.wire.messages import (
    CanFrame,
    Cause,
    CurrentCommand,
    Health,
    Mode,
    PositionerStatus,
    Setpoint,
    StemPosition,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from plant_emulator.parameters import PlantSettings
    from positioner.bench.scenario import Scenario

PERIOD_S = 0.001
SAMPLES_PER_SETPOINT = 10
SECOND_SENSOR_OFF_M = 0.04
_NS = 1_000_000_000


@dataclass(slots=True)
class Loop:
    """Positioner, emulated valve and host, a period at a time; a copy runs on independently."""

    setup: Setup
    plant: PlantSettings
    state: CycleState
    device: DeviceState
    seed: int
    sample: int = 0
    chance: random.Random = field(default_factory=random.Random)
    kept: dict[str, float] = field(default_factory=dict)
    status: PositionerStatus | None = None

    @classmethod
    def of(cls, scenario: Scenario) -> Loop:
        """Return the loop of a bench of `scenario`."""
        configuration, plant = configure(scenario), plant_settings(overrides=scenario.plant)
        setup = Setup(
            configuration.make_codec(), configuration.valve, configuration.guard, configuration.make_law(), PERIOD_S
        )
        return cls(setup, plant, CycleState(), initial_device(plant, scenario.seed), scenario.seed)

    def fork(self) -> Loop:
        """Return a copy, which may continue in another way."""
        other = copy.copy(self)
        other.chance, other.kept = random.Random(self.seed * 1_000_003 + self.sample), {}  # noqa: S311 - no secret
        return other

    @property
    def true_m(self) -> float:
        return self.device.plant.stem.position_m

    def cycle(self, setpoint_m: float, fault: Fault) -> None:
        """Run one period: the host's setpoint when it is due, the reading, the cycle, the valve."""
        codec, inbox = self.setup.codec, []
        if self.sample % SAMPLES_PER_SETPOINT == 0:
            inbox.append(codec.encode(Setpoint(setpoint_m), self.sample // SAMPLES_PER_SETPOINT))
        self.device, published = publish(codec, self.plant, self.device)
        inbox += fault.sensor(self, published)
        self.sample += 1
        self.state, outbox, _ = step(
            self.setup, self.state, CycleInput(tuple(inbox), round(self.sample * PERIOD_S * _NS))
        )
        for frame in outbox:
            message, _ = codec.decode(frame)
            self.status = message if isinstance(message, PositionerStatus) else self.status
        self.device = take(codec, self.device, tuple(fault.actuator(self, outbox)))
        self.device = advance(fault.valve(self), self.device, PERIOD_S)

    @property
    def trouble(self) -> Cause | None:
        """The cause in the last status; None while the status is good."""
        if self.status is None or self.status.health is Health.GOOD:
            return None
        return self.status.cause if self.status.mode is not Mode.INIT else Cause.NONE


@dataclass(frozen=True, slots=True)
class Fault:
    """A fault between the nodes; by default there is none."""

    name: str
    sensor: Callable[[Loop, Iterable[CanFrame]], Iterable[CanFrame]] = lambda _loop, frames: frames
    actuator: Callable[[Loop, Iterable[CanFrame]], Iterable[CanFrame]] = lambda _loop, frames: frames
    valve: Callable[[Loop], PlantSettings] = lambda loop: loop.plant


def _readings(
    loop: Loop, frames: Iterable[CanFrame], change: Callable[[float], float | None]
) -> Iterable[tuple[CanFrame, StemPosition | None, int]]:
    """Yield each frame with its reading and counter; `change` changes a reading, or loses it with None."""
    codec = loop.setup.codec
    for frame in frames:
        message, counter = codec.decode(frame)
        if not isinstance(message, StemPosition):
            yield frame, None, 0
        elif (position_m := change(message.position_m)) is not None:
            changed = replace(message, position_m=position_m)
            yield codec.encode(changed, counter or 0), changed, counter or 0
        else:
            yield CanFrame(0x7FF, b""), message, counter or 0


def _frozen(loop: Loop, frames: Iterable[CanFrame]) -> Iterable[CanFrame]:
    """The reading stays as it is."""
    return [frame for frame, _, _ in _readings(loop, frames, lambda now_m: loop.kept.setdefault("frozen", now_m))]


def _dithered(loop: Loop, frames: Iterable[CanFrame]) -> Iterable[CanFrame]:
    """A value that stays, with the noise of the sensor."""
    here_m = loop.kept.setdefault("dithered", loop.true_m)
    sensor = loop.plant.sensor
    sigma_m = math.hypot(sensor.noise_of_reading * here_m, sensor.noise_of_span * loop.plant.valve.span_m)
    return [frame for frame, _, _ in _readings(loop, frames, lambda _: here_m + loop.chance.gauss(0.0, sigma_m))]


def _doubled(ahead: int | None, lost: float) -> Callable[[Loop, Iterable[CanFrame]], Iterable[CanFrame]]:
    """A second sensor, `ahead` by so many counts (None: anything), beside a first that loses a part of its frames."""

    def sensor(loop: Loop, frames: Iterable[CanFrame]) -> Iterable[CanFrame]:
        lead = round(loop.kept.setdefault("ahead", loop.chance.randrange(256) if ahead is None else ahead))

        def first(now_m: float) -> float | None:
            return None if loop.chance.random() < lost else now_m

        for frame, reading, counter in _readings(loop, frames, first):
            yield frame
            if reading is not None:
                noise_m = loop.chance.gauss(0.0, 1e-4)
                other = replace(reading, position_m=loop.true_m + SECOND_SENSOR_OFF_M + noise_m)
                yield loop.setup.codec.encode(other, counter + lead)

    return sensor


def _commands(change: Callable[[Loop, float], float]) -> Callable[[Loop, Iterable[CanFrame]], Iterable[CanFrame]]:
    """Return a fault of the actuator: the current that acts is `change` of the commanded one."""

    def actuator(loop: Loop, frames: Iterable[CanFrame]) -> Iterable[CanFrame]:
        codec = loop.setup.codec
        for frame in frames:
            message, counter = codec.decode(frame)
            if isinstance(message, CurrentCommand):
                acting = replace(message, current_ma=change(loop, message.current_ma))
                yield codec.encode(acting, counter or 0)

    return actuator


def _without_air(loop: Loop) -> PlantSettings:
    return replace(loop.plant, valve=replace(loop.plant.valve, pressure_gain_pa_per_ma=100.0))


def _stuck(loop: Loop) -> PlantSettings:
    """The stem has a micrometre of play."""
    low_m = loop.kept.setdefault("stuck", loop.true_m)
    travel = {"travel_min_m": low_m, "travel_max_m": low_m + 1e-6, "initial_position_m": low_m}
    return replace(loop.plant, valve=replace(loop.plant.valve, **travel))


HEALTHY = Fault("healthy")
FAULTS = (
    Fault("frozen sensor", sensor=_frozen),
    Fault("dithered sensor", sensor=_dithered),
    Fault("doubled sensor, ahead by 5", sensor=_doubled(5, 0.0)),
    Fault("doubled sensor, first loses 1 %", sensor=_doubled(None, 0.01)),
    Fault("actuator holds its pressure", actuator=_commands(lambda loop, now_ma: loop.kept.setdefault("ma", now_ma))),
    Fault("actuator without air", valve=_without_air),
    Fault("actuator reversed", actuator=_commands(lambda _, now_ma: 24.0 - now_ma)),
    Fault("stem stuck", valve=_stuck),
)
