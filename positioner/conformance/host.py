"""The rules of a host, checked on its frames; nothing is sent to it. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from positioner.conformance.frames import FRAME_RULES, FrameChecks, check_travel
from positioner.conformance.rules import Results, Rule, RuleResult, Violation
from positioner.conformance.timing import FrameTiming
from positioner.wire.messages import HostRequest, ManualCurrent, ManualRequest, Setpoint

if TYPE_CHECKING:
    from positioner.wire.codec import Codec
    from positioner.wire.messages import CanFrame

HOST_RULES = (
    Rule("received", "it sends SETPOINT", "check bus, bit rate, wiring and id_offset; a host sends unasked"),
    *FRAME_RULES,
    Rule(
        "cadence",
        "two SETPOINT frames come within --hold, so that one may be lost",
        "send it cyclically from a timer, every 10 ms for example, even while the setpoint does not change",
    ),
    Rule(
        "silence",
        "SETPOINT is never missing for --hold",
        "go on sending as long as the valve is to be controlled; without it the positioner holds, and later fails safe",
    ),
    Rule("travel", "setpoints lie within --travel", "check the unit: Setpoint_mm is in mm; others are refused"),
    Rule(
        "arm",
        "ARM comes after another request",
        "send NONE from the start and ARM when it is asked for: an ARM that is sent from the start arms nothing",
    ),
    Rule(
        "requests",
        "ARM and DISARM are sent in two frames at least",
        "keep a request for two frames or more: one frame may be lost",
    ),
    Rule(
        "manual",
        "MANUAL_CURRENT comes without a gap of --hold until AUTO is sent",
        "send it cyclically as long as manual mode lasts, and Request = AUTO at its end",
    ),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class HostLimits:
    """The positioner's limits: the age of a setpoint in s, and the travel in m (None where it is not known)."""

    hold_s: float = 0.5
    travel_m: tuple[float, float] | None = None


class HostTest:
    """Checks a host frame by frame; mutable."""

    def __init__(self, codec: Codec, limits: HostLimits, listen_s: float, id_offset: int = 0) -> None:
        """Prepare a test that listens for `listen_s`."""
        self._limits = limits
        self._listen_ns = round(listen_s * 1e9)
        self._begin_ns: int | None = None
        self._results = Results(HOST_RULES)
        self._frames = FrameChecks(codec, (Setpoint, ManualCurrent), self._results, id_offset)
        self._setpoints = FrameTiming(self._results, {"cadence": 0.5 * limits.hold_s, "silence": limits.hold_s})
        self._manual = FrameTiming(self._results, {"manual": limits.hold_s})
        self._request: HostRequest | None = None
        self._request_frames = 0
        self._first_arm: CanFrame | None = None
        self._arms_rightly = False

    def goes_on(self, now_ns: int) -> bool:
        """Begin at the first call; return False when the test is over."""
        if self._begin_ns is None:
            self._begin_ns = now_ns
        return now_ns - self._begin_ns < self._listen_ns

    def receive(self, frame: CanFrame, now_ns: int) -> None:
        """Check `frame`; there is nothing to send."""
        del now_ns
        received = self._frames.receive(frame)
        if received is None:
            return
        match received[0]:
            case Setpoint() as setpoint:
                self._results.passed("received")
                self._setpoints.receive(frame)
                check_travel(self._results, self._limits.travel_m, "Setpoint_mm", setpoint.setpoint_m, frame)
                self._check_request(setpoint.request, frame)
            case ManualCurrent(request=ManualRequest.MANUAL):
                self._manual.receive(frame)
            case ManualCurrent():
                self._results.passed("manual")
                self._manual.first_ns = None
            case _:
                pass

    def results(self, now_ns: int) -> tuple[RuleResult, ...]:
        """End the test, and return the result for every rule."""
        self._setpoints.end(now_ns)
        self._manual.end(now_ns)
        if self._setpoints.first_ns is None:
            self._results.failed("received", Violation("no SETPOINT came"))
        if self._first_arm is not None and not self._arms_rightly:
            self._results.failed("arm", Violation("ARM from the first frame on, and no other request", self._first_arm))
        return self._results.all()

    def _check_request(self, request: HostRequest, frame: CanFrame) -> None:
        before = self._request
        if request is HostRequest.ARM and self._first_arm is None:
            self._first_arm = frame
        if before is not None and request is not before:
            if request is HostRequest.ARM:
                self._arms_rightly = True
                self._results.passed("arm")
            if before is not HostRequest.NONE:
                found = f"{before.name} was sent in {self._request_frames} frame, then came {request.name}"
                self._results.note("requests", None if self._request_frames > 1 else Violation(found, frame))
            self._request_frames = 0
        self._request = request
        self._request_frames += 1
