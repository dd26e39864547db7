"""Plants for conformance tests: a correct one, and one for each mistake, with the rule that must catch it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar

from plant_emulator import device
from plant_emulator.presets import plant_settings
from positioner.wire import e2e
from positioner.wire.codec import make_codec
from positioner.wire.e2e import CounterCheck
from positioner.wire.messages import CanFrame, CurrentCommand, PlantTruth, PositionerAlarms, Quality, StemPosition
from positioner.wire.settings import WireSettings

if TYPE_CHECKING:
    from plant_emulator.parameters import PlantSettings

OFFSET = 0x80
CODEC = make_codec(WireSettings(id_offset=OFFSET))
PERIOD_S, DEADMAN_S = 0.01, 0.1
PLANT = plant_settings("paper", {"deadman_s": DEADMAN_S, "sensor": {"reports_pressure": True}})
TRUTH_ID, POSITION_ID, ALARMS_ID = (CODEC.identifier(kind)[0] for kind in (PlantTruth, StemPosition, PositionerAlarms))


def sealed(frame: CanFrame, data: bytes) -> CanFrame:
    """Return `frame` with other bytes and their CRC."""
    form = CODEC.by_id[frame.arbitration_id, False]
    return replace(frame, data=e2e.protect(data, form.data_id or 0))


def counted(frame: CanFrame, counter: int) -> CanFrame:
    """Return `frame` with another counter."""
    return sealed(frame, bytes([*frame.data[:2], counter % 256, *frame.data[3:]]))


class Plant:
    """The emulator's node, which is correct; a faulty one changes the frames it sends or receives."""

    rule: ClassVar[str] = ""
    settings: ClassVar[PlantSettings] = PLANT
    period_s: ClassVar[float] = PERIOD_S

    def __init__(self) -> None:
        self.state = device.initial_device(self.settings, 1)
        self.sample = 0

    def take(self, frame: CanFrame) -> None:
        received = self.receives(frame)
        if received is not None:
            self.state = device.take(CODEC, self.state, (received,))

    def cycle(self) -> list[CanFrame]:
        self.state = device.advance(self.settings, self.state, self.period_s)
        self.state, frames = device.publish(CODEC, self.settings, self.state)
        self.sample += 1
        sent = (self.sends(frame) for frame in frames if frame.arbitration_id != TRUTH_ID)
        return [frame for frame in sent if frame is not None]

    def sends(self, frame: CanFrame) -> CanFrame | None:
        if frame.arbitration_id != POSITION_ID:
            return frame
        reading, counter = CODEC.decode(frame)
        assert isinstance(reading, StemPosition)
        assert counter is not None
        return CODEC.encode(self.reads(reading), counter)

    def reads(self, reading: StemPosition) -> StemPosition:
        return reading

    def receives(self, frame: CanFrame) -> CanFrame | None:
        return frame


class Silent(Plant):
    rule = "received"

    def sends(self, frame: CanFrame) -> None:
        del frame


class SendsSevenBytes(Plant):
    rule = "format"

    def sends(self, frame: CanFrame) -> CanFrame:
        return replace(frame, data=frame.data[:7])


class SendsExtendedFrames(Plant):
    rule = "format"

    def sends(self, frame: CanFrame) -> CanFrame:
        return replace(frame, is_extended=True)


class SendsRemoteFrames(Plant):
    rule = "format"

    def sends(self, frame: CanFrame) -> CanFrame:
        return replace(frame, is_remote=True)


class SendsNoCrc(Plant):
    rule = "crc"

    def sends(self, frame: CanFrame) -> CanFrame:
        return replace(frame, data=bytes(2) + frame.data[2:])


class SendsAnUndefinedQuality(Plant):
    rule = "values"

    def sends(self, frame: CanFrame) -> CanFrame:
        return sealed(frame, bytes([*frame.data[:7], frame.data[7] | 0x90]))


class LeavesRubbishInUnusedBits(Plant):
    rule = "spare"

    def sends(self, frame: CanFrame) -> CanFrame:
        return frame if frame.arbitration_id == POSITION_ID else sealed(frame, frame.data[:7] + b"\x01")


class HasAMessageUnderAnIdentifierOfThePositioner(Plant):
    rule = "identifiers"

    def cycle(self) -> list[CanFrame]:
        return [*super().cycle(), CanFrame(ALARMS_ID, b"\x17" * 8)]


class NeverCounts(Plant):
    rule = "counter"

    def sends(self, frame: CanFrame) -> CanFrame:
        return counted(frame, 7)


class HasOneCounterForAllMessages(Plant):
    rule = "counter"

    def sends(self, frame: CanFrame) -> CanFrame:
        return counted(frame, 2 * self.sample + (frame.arbitration_id == POSITION_ID))


class IsTooSlow(Plant):
    rule = "period"
    period_s = 1.2 * PERIOD_S


class Pauses(Plant):
    rule = "gaps"

    def sends(self, frame: CanFrame) -> CanFrame | None:
        return None if self.sample % 100 > 95 else frame


class MeasuresInAnotherUnit(Plant):
    rule = "travel"

    def reads(self, reading: StemPosition) -> StemPosition:
        return replace(reading, position_m=10.0 * reading.position_m)


class CallsItselfValidBeforeAnyCommand(Plant):
    rule = "first"

    def reads(self, reading: StemPosition) -> StemPosition:
        return reading if self.state.current_ma is not None else replace(reading, quality=Quality.VALID)


class EchoesAnOldCounter(Plant):
    rule = "echo"

    def reads(self, reading: StemPosition) -> StemPosition:
        return replace(reading, command_counter=((reading.command_counter or 0) - 30) % 256)


class ObeysNothing(Plant):
    rule = "obeys"

    def receives(self, frame: CanFrame) -> None:
        del frame


class LivesOnRepeatedCommands(Plant):
    rule = "repeat"

    def receives(self, frame: CanFrame) -> CanFrame:
        if len(frame.data) > 2 and frame.data[2] == self.state.command_counter:
            self.state = replace(self.state, command_check=CounterCheck())
        return frame


class ChecksNoCrc(Plant):
    rule = "damage"

    def receives(self, frame: CanFrame) -> CanFrame:
        return sealed(frame, frame.data) if len(frame.data) == 8 else frame


class LivesOnDamagedCommands(Plant):
    rule = "damage"

    def receives(self, frame: CanFrame) -> CanFrame:
        self.state = replace(self.state, commanded_s=self.state.plant.time_s)
        return frame


class ChecksNoCounter(Plant):
    rule = "old"

    def receives(self, frame: CanFrame) -> CanFrame:
        self.state = replace(self.state, command_check=CounterCheck())
        return frame


class TakesShortFrames(Plant):
    rule = "short"

    def receives(self, frame: CanFrame) -> CanFrame:
        return sealed(frame, frame.data + b"\0") if len(frame.data) == 7 else frame


class HasNoDeadman(Plant):
    rule = "deadman"
    settings = replace(PLANT, deadman_s=60.0)


class HidesItsFailPosition(Plant):
    rule = "deadman"

    def reads(self, reading: StemPosition) -> StemPosition:
        return replace(reading, quality=Quality.VALID)


class GivesUpAtOnce(Plant):
    rule = "grace"
    settings = replace(PLANT, deadman_s=0.015)


class StaysInItsFailPosition(Plant):
    rule = "rejoins"

    def receives(self, frame: CanFrame) -> CanFrame | None:
        return None if self.state.failed else frame


class NeverObeysARestartedController(Plant):
    rule = "restart"

    def receives(self, frame: CanFrame) -> CanFrame:
        self.state = replace(self.state, command_check=replace(self.state.command_check, candidate=None))
        return frame


class TakesAFailureSignalForAValue(Plant):
    rule = "failure-signal"

    def receives(self, frame: CanFrame) -> CanFrame:
        if len(frame.data) != 8 or int.from_bytes(frame.data[3:5], "little") > 4000:
            return frame
        command, counter = CODEC.decode(frame)
        assert isinstance(command, CurrentCommand)
        assert counter is not None
        return CODEC.encode(replace(command, current_ma=4.0), counter)
