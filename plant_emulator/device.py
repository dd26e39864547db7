"""The valve as a node on the bus: frames in, frames out. Pure.

The node accepts every valid command, and reports the measured and the true position. Like a real actuator it goes to
its fail position by itself: after `deadman_s` without a command, or at once on a current that is a failure signal
(NAMUR NE 43). The next valid command ends this. As long as no command acts, also before the first one, the quality of
its readings is FAIL_POSITION.
"""

from __future__ import annotations

from dataclasses import field
from typing import TYPE_CHECKING

from plant_emulator import sensor, valve
from plant_emulator.parameters import FailPosition, PlantSettings
from positioner.values import dataclass, replace
from positioner.wire.e2e import CounterCheck, Sequence
from positioner.wire.formats import FrameRejectedError
from positioner.wire.loop_current import LoopSignal, signal_of
from positioner.wire.messages import (
    ActuatorState,
    CanFrame,
    CurrentCommand,
    PlantTruth,
    Quality,
    Setpoint,
    StemPosition,
)

if TYPE_CHECKING:
    from plant_emulator.valve import PlantState
    from positioner.wire.codec import Codec

_SAME_INSTANT_S = 1e-12
_NO_SIGNAL_MA = 0.0
_FULL_SIGNAL_MA = 20.0
_SPEED_LIMIT_M_PER_S = 8.19
_TRUTH_RANGE_M = (-0.01, 0.661)


@dataclass(slots=True, kw_only=True)
class DeviceState:
    """The node's state; each function here changes a copy of its own.

    current_ma: the last command that is a value; None until the first one, while the actuator keeps its first current.
    commanded_s: plant time of the last command.
    signal_failed: the command in force is a failure signal.
    failed: the valve is on its way to its fail position, or there.
    position_counter: the counter of the next position frame.
    answered: the counter of the position frame that the command in force answers; None where the frame has none.
    commands, setpoints: numbers of fresh frames received.
    """

    plant: PlantState
    current_ma: float | None = None
    commanded_s: float = 0.0
    command_counter: int = 0
    position_counter: int = 0
    answered: int | None = None
    commands: int = 0
    setpoints: int = 0
    command_check: CounterCheck = field(default_factory=CounterCheck)
    setpoint_check: CounterCheck = field(default_factory=CounterCheck)
    signal_failed: bool = False
    failed: bool = False

    @property
    def obeys(self) -> bool:
        """Whether a command acts on the valve."""
        return self.current_ma is not None and not self.failed


def initial_device(settings: PlantSettings, seed: int) -> DeviceState:
    """Return a node that has sent and received nothing, its valve at rest."""
    return DeviceState(plant=valve.initial_state(settings, seed))


def take(codec: Codec, state: DeviceState, frames: tuple[CanFrame, ...]) -> DeviceState:
    """Return the state after `frames`; frames that are damaged, repeated or not for an actuator are ignored."""
    state = replace(state)
    for frame in frames:
        try:
            message, counter = codec.decode(frame)
        except FrameRejectedError:
            continue
        if isinstance(message, CurrentCommand):
            _take_command(state, message, counter, codec.by_kind[CurrentCommand].counter_modulus)
        elif isinstance(message, Setpoint):
            check = _counting(state.setpoint_check, codec.by_kind[Setpoint].counter_modulus)
            state.setpoint_check, verdict, _ = check.check(counter or 0)
            fresh = counter is None or verdict is Sequence.FRESH
            state.setpoints += fresh
    return state


def _counting(check: CounterCheck, modulus: int) -> CounterCheck:
    """Return `check`, or before the first frame one for counters that wrap at `modulus`."""
    return check if check.modulus == modulus else CounterCheck(modulus=modulus)


def _take_command(state: DeviceState, message: CurrentCommand, counter: int | None, modulus: int) -> None:
    if counter is not None:
        state.command_check, verdict, _ = _counting(state.command_check, modulus).check(counter)
        if verdict is not Sequence.FRESH:
            return
        state.command_counter = counter
    signal_failed = signal_of(message.current_ma) is LoopSignal.FAILURE
    if not signal_failed:
        state.current_ma = message.current_ma
    state.commands += 1
    state.commanded_s = state.plant.time_s
    state.answered = message.position_counter
    state.signal_failed = state.failed = signal_failed


def advance(settings: PlantSettings, state: DeviceState, duration_s: float) -> DeviceState:
    """Return the state `duration_s` later: under the command in force, or in the fail position once it is too old."""
    state = replace(state)
    plant = state.plant
    held_ma = state.current_ma
    if held_ma is None:
        held_ma = plant.actuator.line.newest_ma
    alive_s = max(0.0, min(duration_s, state.commanded_s + settings.deadman_s - plant.time_s))
    if state.signal_failed:
        alive_s = 0.0
    elif state.current_ma is None or alive_s >= duration_s - _SAME_INSTANT_S:
        state.plant = valve.step(settings, plant, held_ma, duration_s)
        return state
    if alive_s > 0.0:  # pragma: no mutate - a step of no time changes nothing
        plant = valve.step(settings, plant, held_ma, alive_s)
    state.plant = valve.step(settings, plant, _fail_current_ma(settings, held_ma), duration_s - alive_s)
    state.failed = True
    return state


def _fail_current_ma(settings: PlantSettings, last_ma: float) -> float:
    match settings.fail_position:
        case FailPosition.CLOSE:
            return _NO_SIGNAL_MA
        case FailPosition.OPEN:
            return _FULL_SIGNAL_MA
        case FailPosition.CURRENT:
            return settings.fail_current_ma
        case _:  # HOLD
            return last_ma


def failure(settings: PlantSettings, state: DeviceState) -> str:
    """Return why the valve is in its fail position, and which one that is; empty when it is not."""
    if not state.failed:
        return ""
    why = (
        "the command is a failure signal" if state.signal_failed else f"no command for {settings.deadman_s * 1e3:g} ms"
    )
    at = f" ({settings.fail_current_ma:g} mA)" if settings.fail_position is FailPosition.CURRENT else ""
    return f"{why}: fail position '{settings.fail_position}'{at}"


def publish(codec: Codec, settings: PlantSettings, state: DeviceState) -> tuple[DeviceState, tuple[CanFrame, ...]]:
    """Return the state and the frames of this sample: the true position for benches, then the reading.

    As with a real sensor, a reading beyond the range of its signal is the end of that range.
    """
    plant, measured_m = valve.measure(settings, state.plant)
    speed = min(max(plant.stem.velocity_m_per_s, -_SPEED_LIMIT_M_PER_S), _SPEED_LIMIT_M_PER_S)
    true_m = min(max(plant.stem.position_m, _TRUTH_RANGE_M[0]), _TRUTH_RANGE_M[1])
    quality = Quality.VALID if state.obeys else Quality.FAIL_POSITION
    counter = state.position_counter
    frames: tuple[CanFrame, ...] = (
        codec.encode(PlantTruth(true_m, speed), counter),
        codec.encode(StemPosition(_held(codec, StemPosition, measured_m), state.command_counter, quality), counter),
    )
    if settings.sensor.reports_pressure:
        pressure_pa = sensor.pressure_pa(settings, plant.sensor, plant.actuator.pressure_pa)
        frames = (codec.encode(ActuatorState(_held(codec, ActuatorState, pressure_pa)), counter), *frames)
    state = replace(state, plant=plant, position_counter=counter + 1)
    return state, frames


def _held(codec: Codec, kind: type[StemPosition | ActuatorState], value: float) -> float:
    """Return a reading within the range of its signal."""
    form = codec.field(kind, "position_m" if kind is StemPosition else "pressure_pa")
    return min(max(value, form.lowest), form.highest)
