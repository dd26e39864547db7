"""Hosts for conformance tests: a correct one, and one for each mistake, with the rule that must catch it."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

from conformance_plants import ALARMS_ID, CODEC, counted, sealed

from positioner.wire.messages import CanFrame, HostRequest, ManualCurrent, ManualRequest, Setpoint

PERIOD_S = 0.01
NONE, ARM, DISARM = HostRequest


class Host:
    """Arms after a second, moves by hand for a second after three, and disarms after eight."""

    rule: ClassVar[str] = ""
    setpoint_m: ClassVar[float] = 0.08

    def __init__(self) -> None:
        self.sample = 0

    def cycle(self) -> list[CanFrame]:
        """Return the frames of the next sample; a sample comes every `PERIOD_S`."""
        time_s = self.sample * PERIOD_S
        frames: list[CanFrame | None] = []
        if self.speaks(time_s):
            frames.append(self.sends(CODEC.encode(Setpoint(self.setpoint_m, self.asks(time_s)), self.sample)))
        if self.sample % 5 == 0 and (request := self.by_hand(time_s)) is not None:
            frames.append(CODEC.encode(ManualCurrent(9.5, request), self.sample // 5))
        self.sample += 1
        return [frame for frame in frames if frame is not None]

    def speaks(self, time_s: float) -> bool:
        del time_s
        return True

    def asks(self, time_s: float) -> HostRequest:
        return DISARM if time_s > 8.0 else ARM if time_s > 1.0 else NONE

    def by_hand(self, time_s: float) -> ManualRequest | None:
        if 3.0 < time_s < 4.0:
            return ManualRequest.MANUAL
        return ManualRequest.AUTO if 4.0 <= time_s < 4.5 else None

    def sends(self, frame: CanFrame) -> CanFrame | None:
        return frame


class Silent(Host):
    rule = "received"

    def sends(self, frame: CanFrame) -> None:
        del frame


class SendsRemoteFrames(Host):
    rule = "format"

    def sends(self, frame: CanFrame) -> CanFrame:
        return replace(frame, is_remote=True)


class SwapsTheCrc(Host):
    rule = "crc"

    def sends(self, frame: CanFrame) -> CanFrame:
        return replace(frame, data=frame.data[1::-1] + frame.data[2:])


class AsksForWhatDoesNotExist(Host):
    rule = "values"

    def sends(self, frame: CanFrame) -> CanFrame:
        return sealed(frame, bytes([*frame.data[:6], frame.data[6] & 0x0F | 0x70, frame.data[7]]))


class LeavesRubbishInUnusedBits(Host):
    rule = "spare"

    def sends(self, frame: CanFrame) -> CanFrame:
        return sealed(frame, frame.data[:7] + b"\xff")


class HasAMessageUnderAnIdentifierOfThePositioner(Host):
    rule = "identifiers"

    def cycle(self) -> list[CanFrame]:
        return [*super().cycle(), CanFrame(ALARMS_ID, b"\x17" * 8)]


class CountsByTwo(Host):
    rule = "counter"

    def sends(self, frame: CanFrame) -> CanFrame:
        return counted(frame, 2 * self.sample)


class SpeaksSeldom(Host):
    rule = "cadence"

    def speaks(self, time_s: float) -> bool:
        del time_s
        return self.sample % 30 == 0


class Pauses(Host):
    rule = "silence"

    def speaks(self, time_s: float) -> bool:
        return not 5.0 < time_s < 5.6


class FallsSilent(Host):
    rule = "silence"

    def speaks(self, time_s: float) -> bool:
        return time_s < 9.0


class SpeaksInMetres(Host):
    rule = "travel"
    setpoint_m = 0.2


class HoldsArmFromTheStart(Host):
    rule = "arm"

    def asks(self, time_s: float) -> HostRequest:
        del time_s
        return ARM


class AsksOnce(Host):
    rule = "requests"

    def asks(self, time_s: float) -> HostRequest:
        del time_s
        return ARM if self.sample == 100 else NONE


class ForgetsToEndManualMode(Host):
    rule = "manual"

    def by_hand(self, time_s: float) -> ManualRequest | None:
        return ManualRequest.MANUAL if 3.0 < time_s < 4.0 else None
