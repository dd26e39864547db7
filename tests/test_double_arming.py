"""Two daemons with state directories of their own on one bus, and one host that arms them both."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from daemon_helpers import HERE_M, PERIOD_S, Service, own_address

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
        host = one.others
        for turn in range(150):
            host.say(StemPosition(HERE_M), Setpoint(HERE_M, HostRequest.ARM if turn >= 25 else HostRequest.NONE))
            host.listen(PERIOD_S)
        modes = [service.told("mode ")[-1].partition(" -> ")[2] for service in (one, other)]
        assert sum(mode.startswith("ACTIVE") for mode in modes) <= 1, modes
        # whoever heard the other has told it; the one that was the first alone has heard nobody
        for service, mode in zip((one, other), modes, strict=True):
            assert service.told("another controller commands this valve") or mode.startswith("ACTIVE"), modes
