"""Live feedback: whether valid position frames come, how often, and which frames come instead. Shell."""

from __future__ import annotations

import errno
import os
import time
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from positioner.bus.port import BusPort
from positioner.doctor.finding import Finding, Level
from positioner.errors import BusError
from positioner.wire.formats import FrameRejectedError
from positioner.wire.messages import Cause, CurrentCommand, PositionerStatus, Quality, StemPosition

if TYPE_CHECKING:
    from collections.abc import Iterator

    from positioner.bus.address import BusAddress
    from positioner.wire.codec import Codec
    from positioner.wire.messages import CanFrame

LISTENING_S = 1.0
_ENOUGH = 200
"""After so many position frames listening ends."""
_RATE_TOLERANCE = 0.2
_FEWEST_FOR_A_RATE = 5
_MOST_IDENTIFIERS = 4
_SUBJECT = "feedback"


@dataclass(slots=True)
class BusTraffic:
    """The frames received: instants of valid position frames in ns, commands, the last status, others by kind."""

    positions_ns: list[int] = field(default_factory=list)
    last_position_m: float | None = None
    commands: int = 0
    faults: int = 0
    cause: Cause | None = None
    refused: Counter[str] = field(default_factory=Counter)
    others: Counter[str] = field(default_factory=Counter)

    def add(self, codec: Codec, frames: tuple[CanFrame, ...]) -> None:
        """Count `frames`, oldest first."""
        for frame in frames:
            try:
                message, _ = codec.decode(frame)
            except FrameRejectedError as error:
                if error.counted is None:
                    self.others[f"{frame.arbitration_id:X}"] += 1
                else:
                    self.refused[str(error)] += 1
                continue
            if isinstance(message, StemPosition):
                self.faults += message.quality is Quality.FAULT
                if message.quality is not Quality.FAULT:
                    self.positions_ns.append(frame.received_ns)
                    self.last_position_m = message.position_m
            elif isinstance(message, CurrentCommand):
                self.commands += 1
            elif isinstance(message, PositionerStatus):
                self.cause = message.cause

    @property
    def rate_per_s(self) -> float | None:
        """Valid position frames per second, None where there are too few."""
        if len(self.positions_ns) < _FEWEST_FOR_A_RATE or self.positions_ns[-1] == self.positions_ns[0]:
            return None
        return (len(self.positions_ns) - 1) / (self.positions_ns[-1] - self.positions_ns[0]) * 1e9


def listen(address: BusAddress, codec: Codec) -> BusTraffic:
    """Return what comes within `LISTENING_S`, or in less time where enough position frames come; nothing is sent.

    Raises:
        BusError: the bus cannot be opened.
    """
    traffic = BusTraffic()
    port = BusPort(address)
    port.open()
    try:
        end_s = time.monotonic() + LISTENING_S
        while len(traffic.positions_ns) < _ENOUGH and (left_s := end_s - time.monotonic()) > 0.0:
            traffic.add(codec, port.receive(left_s))
    finally:
        port.close()
    return traffic


def findings(address: BusAddress, codec: Codec, period_s: float, *, daemon_runs: bool) -> Iterator[Finding]:
    """Yield the findings on the bus; `period_s` is the sample period of the configuration."""
    try:
        traffic = listen(address, codec)
    except BusError as error:
        text, _, fix = str(error).rpartition("; ")
        unknown = address.interface == "socketcan" and os.strerror(errno.EAFNOSUPPORT) in text
        yield Finding(Level.FAIL, _SUBJECT, text, "sudo modprobe can-raw" if unknown else fix.removeprefix("try: "))
        return
    yield assessed(traffic, address, period_s)
    if traffic.commands and not daemon_runs:
        text = f"{traffic.commands} command frames came, and no daemon of this valve runs here"
        yield Finding(Level.WARN, "foreign", f"{text}: another controller commands the valve", _look(address))
    if traffic.cause is Cause.VALVE_DIFFERS:
        text = "the running positioner says that the valve does not move as configured"
        yield Finding(Level.WARN, "valve", text, "positioner identify --config FILE --write")


def assessed(traffic: BusTraffic, address: BusAddress, period_s: float) -> Finding:
    """Return the finding on the position frames, or on their absence."""
    if not traffic.positions_ns:
        instead = _instead(traffic)
        return Finding(Level.FAIL, _SUBJECT, f"no valid position frame in {LISTENING_S:g} s; {instead}", _look(address))
    assert traffic.last_position_m is not None  # noqa: S101 - set with the first instant
    rate, wanted = traffic.rate_per_s, 1.0 / period_s
    if rate is None:
        frames = f"{len(traffic.positions_ns)} frames in {LISTENING_S:g} s"
        is_right = wanted * LISTENING_S < _FEWEST_FOR_A_RATE
    else:
        frames, is_right = f"{rate:.4g} frames/s", abs(rate / wanted - 1.0) <= _RATE_TOLERANCE
    text = f"stem at {traffic.last_position_m * 1e3:.2f} mm, {frames}"
    if is_right:
        return Finding(Level.OK, _SUBJECT, text)
    text += f", but the configuration says {wanted:g} (control.sample_period_s)"
    return Finding(Level.WARN, _SUBJECT, text, _look(address))


def _instead(traffic: BusTraffic) -> str:
    if traffic.faults:
        return f"the sensor reports a fault in {traffic.faults} frames"
    if traffic.refused:
        reason, count = traffic.refused.most_common(1)[0]
        return f"{count} frames were refused: {reason}"
    if traffic.others:
        shown = ", ".join(identifier for identifier, _ in traffic.others.most_common(_MOST_IDENTIFIERS))
        return f"{traffic.others.total()} frames with other identifiers came: {shown}"
    return "the bus is silent"


def _look(address: BusAddress) -> str:
    if address.interface != "socketcan":
        return f"plant-emulator run --bus {address}  # or whatever sends position frames on this bus"
    return f"candump -tz {address.channel}  # is the sensor on, at this bitrate, with this identifier?"
