"""An examination on a bus: frames in, commands out, until it is over or somebody interrupts it. Shell."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Protocol

from positioner.bus.port import BusPort
from positioner.errors import BusError
from positioner.wire.messages import CurrentCommand

if TYPE_CHECKING:
    from positioner.bus.address import BusAddress
    from positioner.conformance.rules import Finding
    from positioner.wire.codec import Codec
    from positioner.wire.messages import CanFrame

_WAIT_S = 0.05


class Examination(Protocol):
    """What judges frames, and may want one sent after each."""

    def at(self, now_ns: int) -> bool:
        """Let time pass; return False when the examination is over."""

    def hear(self, frame: CanFrame, now_ns: int) -> CanFrame | None:
        """Judge a frame that was received some time before `now_ns`, and return what to send at once."""

    def findings(self, now_ns: int) -> tuple[Finding, ...]:
        """Return the verdicts."""


def examine(
    address: BusAddress, codec: Codec, examination: Examination, *, alone: bool
) -> tuple[tuple[Finding, ...], int]:
    """Return the findings on a bus, and the monotonic instant in ns at which the examination began.

    Ctrl-C ends it early. `alone`: nobody else may command the plant, since this examination will.

    Raises:
        BusError: the bus cannot be used, or another controller is on it.
    """
    command = codec.identifier(CurrentCommand)
    port = BusPort(address)
    port.open()
    start_ns = time.monotonic_ns()
    try:
        while examination.at(time.monotonic_ns()):
            for frame in port.receive(_WAIT_S):
                if alone and (frame.arbitration_id, frame.is_extended) == command:
                    raise BusError(f"another controller commands the plant on {address}: stop it first")
                answer = examination.hear(frame, time.monotonic_ns())
                if answer is not None:
                    port.send(answer)
    except KeyboardInterrupt:
        pass
    finally:
        port.close()
    return examination.findings(time.monotonic_ns()), start_ns
