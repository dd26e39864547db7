"""The rules of a host, judged from its frames; nothing is sent to it. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from positioner.conformance.cadence import Cadence
from positioner.conformance.frames import FRAME_RULES, FrameWatch
from positioner.conformance.rules import Finding, Ledger, Offence, Rule
from positioner.wire.messages import HostRequest, ManualCurrent, ManualRequest, Setpoint

if TYPE_CHECKING:
    from positioner.wire.codec import Codec
    from positioner.wire.messages import CanFrame

HOST_RULES = (
    Rule("heard", "it sends SETPOINT", "check bus, bit rate, wiring and id_offset; the host sends unasked"),
    *FRAME_RULES,
    Rule(
        "cadence",
        "two SETPOINT frames come within --hold, so that one may be lost",
        "send it cyclically from a timer, every 10 ms for example, whether or not the setpoint changes",
    ),
    Rule(
        "silence",
        "SETPOINT never stays away for --hold",
        "go on sending as long as the valve is to be controlled: the positioner holds there, and fails safe later",
    ),
    Rule("travel", "setpoints lie within --travel", "check the unit: Setpoint_mm is in mm; others are refused"),
    Rule(
        "arm",
        "ARM comes after another request",
        "send NONE from the start and ARM when it is asked for: an ARM that is held all the time arms nothing",
    ),
    Rule(
        "requests",
        "ARM and DISARM stand for two frames at least",
        "keep a request for two frames or more: one frame may be lost",
    ),
    Rule(
        "manual",
        "MANUAL_CURRENT goes on without a gap of --hold until AUTO is sent",
        "send it cyclically as long as manual mode lasts, and Request = AUTO at its end",
    ),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class HostLimits:
    """What the positioner allows: the age of a setpoint in s, and its travel in m, None where it is not told."""

    hold_s: float = 0.5
    travel_m: tuple[float, float] | None = None


class HostExamination:
    """Judges a host frame by frame; mutable."""

    def __init__(self, codec: Codec, limits: HostLimits, listen_s: float, id_offset: int = 0) -> None:
        """Begin before the first frame."""
        self._limits = limits
        self._listen_ns = round(listen_s * 1e9)
        self._begin_ns: int | None = None
        self._ledger = Ledger(HOST_RULES)
        self._watch = FrameWatch(codec, (Setpoint, ManualCurrent), self._ledger, id_offset)
        self._cadence = Cadence(self._ledger, {"cadence": 0.5 * limits.hold_s, "silence": limits.hold_s})
        self._manual = Cadence(self._ledger, {"manual": limits.hold_s})
        self._request: HostRequest | None = None
        self._stood = 0
        self._armed_by: CanFrame | None = None
        self._arms_rightly = False

    def at(self, now_ns: int) -> bool:
        """Let time pass; return False when the examination is over."""
        if self._begin_ns is None:
            self._begin_ns = now_ns
        return now_ns - self._begin_ns < self._listen_ns

    def hear(self, frame: CanFrame, now_ns: int) -> None:
        """Judge `frame`; nothing is sent after it."""
        del now_ns
        heard = self._watch.hear(frame)
        if heard is None:
            return
        match heard[0]:
            case Setpoint() as setpoint:
                self._ledger.keep("heard")
                self._cadence.hear(frame)
                self._judge(setpoint, frame)
            case ManualCurrent(request=ManualRequest.MANUAL):
                self._manual.hear(frame)
            case ManualCurrent():
                self._ledger.keep("manual")
                self._manual.first_ns = None
            case _:
                pass

    def findings(self, now_ns: int) -> tuple[Finding, ...]:
        """Return the verdicts at the end of the examination."""
        self._cadence.end(now_ns)
        self._manual.end(now_ns)
        if self._cadence.first_ns is None:
            self._ledger.offend("heard", Offence("no SETPOINT came"))
        if self._armed_by is not None and not self._arms_rightly:
            self._ledger.offend("arm", Offence("ARM from the first frame on, and no other request", self._armed_by))
        return self._ledger.findings()

    def _judge(self, setpoint: Setpoint, frame: CanFrame) -> None:
        if self._limits.travel_m is not None:
            low_m, high_m = self._limits.travel_m
            inside = low_m <= setpoint.setpoint_m <= high_m
            told = f"Setpoint_mm = {setpoint.setpoint_m * 1e3:g}"
            self._ledger.judge("travel", None if inside else Offence(told, frame))
        before, request = self._request, setpoint.request
        if request is HostRequest.ARM and self._armed_by is None:
            self._armed_by = frame
        if before is not None and request is not before:
            self._arms_rightly |= request is HostRequest.ARM
            if request is HostRequest.ARM:
                self._ledger.keep("arm")
            if before is not HostRequest.NONE:
                told = f"{before.name} stood for {self._stood} frame, then came {request.name}"
                self._ledger.judge("requests", None if self._stood > 1 else Offence(told, frame))
            self._stood = 0
        self._request = request
        self._stood += 1
