"""Two daemons with state directories of their own on one bus, and one host that arms them both."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import pytest
from daemon_helpers import HERE_M, PATIENCE_S, PERIOD_S, Service, own_address

from positioner.wire.messages import HostRequest, Setpoint, StemPosition

if TYPE_CHECKING:
    from pathlib import Path


PATIENT = {"feedback_hold_periods": 500, "feedback_failsafe_periods": 5000, "setpoint_hold_s": 0.0,
           "setpoint_failsafe_s": 0.0}  # fmt: skip
"""Ages that a busy machine does not reach between two frames of a test."""


@pytest.mark.bus
def test_two_daemons_that_one_arm_has_armed_do_not_both_go_on(tmp_path: Path) -> None:
    bus = own_address()
    folders = [tmp_path / "one", tmp_path / "other"]
    for folder in folders:
        folder.mkdir()
    with Service(folders[0], bus=bus, guard=PATIENT) as one, Service(folders[1], bus=bus, guard=PATIENT) as other:
        host, deadline_s, modes, turn = one.others, time.monotonic() + PATIENCE_S, ["", ""], 0
        while not (
            all("ACTIVE" in told for told in modes) and sum(told.endswith("ACTIVE (none)") for told in modes) < 2
        ):
            assert time.monotonic() < deadline_s, modes
            turn += 1
            host.say(StemPosition(HERE_M), Setpoint(HERE_M, HostRequest.ARM if turn >= 25 else HostRequest.NONE))
            said_s = time.monotonic()
            while (left_s := said_s + PERIOD_S - time.monotonic()) > 0.0:
                host.listen(left_s)
            modes = [" ".join(service.logged("mode ")) for service in (one, other)]
        # whoever heard the other has told it; the one that was the first alone has heard nobody
        for service, mode in zip((one, other), modes, strict=True):
            assert service.logged("another controller commands this valve") or mode.endswith("ACTIVE (none)"), modes
