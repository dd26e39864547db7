"""A conformance test on a bus: frames in, commands out, until it is over or interrupted. Shell."""

from __future__ import annotations

import time
from contextlib import suppress
from typing import TYPE_CHECKING, Protocol

from positioner.bus.port import BusPort
from positioner.errors import BusError
from positioner.wire.messages import CurrentCommand

if TYPE_CHECKING:
    from positioner.bus.address import BusAddress
    from positioner.conformance.rules import RuleResult
    from positioner.wire.codec import Codec
    from positioner.wire.messages import CanFrame

_WAIT_S = 0.05


class ConformanceTest(Protocol):
    """A test of one node."""

    def goes_on(self, now_ns: int) -> bool:
        """Begin at the first call, go on to the next phase when it is due; return False when the test is over."""

    def receive(self, frame: CanFrame, now_ns: int) -> CanFrame | None:
        """Check a frame that was received some time before `now_ns`, and return the frame to send at once."""

    def results(self, now_ns: int) -> tuple[RuleResult, ...]:
        """End the test, and return the result for every rule."""


def run_test(
    address: BusAddress, codec: Codec, test: ConformanceTest, *, alone: bool
) -> tuple[tuple[RuleResult, ...], int]:
    """Return the results on a bus, and the monotonic instant in ns at which the test began.

    Ctrl-C ends the test early. `alone`: no other controller may command the plant, because the test commands it.

    Raises:
        BusError: the bus cannot be used, or another controller is on it.
    """
    command = codec.identifier(CurrentCommand)
    port = BusPort(address)
    port.open()
    start_ns = time.monotonic_ns()
    try:
        with suppress(KeyboardInterrupt):
            while test.goes_on(time.monotonic_ns()):
                for frame in port.receive(_WAIT_S):
                    if alone and frame.identifier == command:
                        raise BusError(f"another controller commands the plant on {address}: stop it first")
                    answer = test.receive(frame, time.monotonic_ns())
                    if answer is not None:
                        port.send(answer)
    finally:
        port.close()
    return test.results(time.monotonic_ns()), start_ns
