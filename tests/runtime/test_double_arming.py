"""Two daemons with state directories of their own, and one ARM that both accept."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import pytest
from daemon_helpers import HERE_M, PERIOD_S, TIMEOUT_S, Service

from positioner.wire.messages import HostRequest, Setpoint, StemPosition

if TYPE_CHECKING:
    from pathlib import Path


LONG_TIMEOUTS = {"feedback_hold_periods": 500, "feedback_failsafe_periods": 5000, "setpoint_hold_s": 0.0,
                 "setpoint_failsafe_s": 0.0}  # fmt: skip
"""Timeouts that a busy machine does not reach between two frames of a test."""


@pytest.mark.bus
def test_two_daemons_that_one_arm_has_armed_do_not_both_go_on(tmp_path: Path) -> None:
    """Each has a bus of its own until both send commands; then the test passes the frames of each on to the other.

    On one bus of a busy machine one daemon might receive the other's command before the ARM, and refuse to be armed.
    """
    folders = [tmp_path / "one", tmp_path / "other"]
    for folder in folders:
        folder.mkdir()
    with Service(folders[0], guard=LONG_TIMEOUTS) as one, Service(folders[1], guard=LONG_TIMEOUTS) as other:
        services, deadline_s, cycles, joined = (one, other), time.monotonic() + TIMEOUT_S, 0, False
        modes: list[str] = ["", ""]
        while not joined or all(mode.rpartition("-> ")[2].startswith("ACTIVE") for mode in modes):
            assert time.monotonic() < deadline_s, modes
            cycles += 1
            for service in services:
                reading = StemPosition(HERE_M, service.others.acting)
                service.others.say(reading, Setpoint(HERE_M, HostRequest.ARM if cycles >= 25 else HostRequest.NONE))
            said_s = time.monotonic()
            while time.monotonic() < said_s + PERIOD_S:
                for service, its_other in ((one, other), (other, one)):
                    count = len(service.others.received)
                    service.others.listen(PERIOD_S / 10.0)
                    for frame in service.others.received[count:] if joined else ():
                        its_other.others.port.send(frame)
            joined = joined or all(service.others.acting is not None for service in services)
            modes = [" ".join(service.logged("mode ")) for service in services]
        # a daemon that received the other's commands has logged it; the other may have been disarmed before any more
        for service, mode in zip(services, modes, strict=True):
            assert service.logged("another controller commands this valve") or mode.endswith("ACTIVE (none)"), modes
