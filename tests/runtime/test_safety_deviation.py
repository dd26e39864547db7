"""A stem that stays away from its setpoint, seen by the daemon on a bus: reported once, and never 'good'."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from daemon_helpers import HERE_M, Loop

from positioner.wire.messages import (
    Cause,
    CurrentCommand,
    Health,
    HostRequest,
    Mode,
    PositionerStatus,
    Setpoint,
    StemPosition,
)

if TYPE_CHECKING:
    from pathlib import Path

    from positioner.wire.messages import Message


def sample(loop: Loop, setpoint_m: float, position_m: float) -> list[Message]:
    """One period of a node that obeys: its reading names the last command."""
    reading = loop.others.frame(StemPosition(position_m, loop.others.acting))
    return loop.cycle(loop.others.frame(Setpoint(setpoint_m)), reading)


def last_status(loop: Loop, samples: int, setpoint_m: float, position_m: float = HERE_M) -> PositionerStatus:
    sent = [message for _ in range(samples) for message in sample(loop, setpoint_m, position_m)]
    assert [message for message in sent if isinstance(message, CurrentCommand)]
    return [message for message in sent if isinstance(message, PositionerStatus)][-1]


def trouble(status: PositionerStatus) -> tuple[Mode, Cause, Health]:
    return status.mode, status.cause, status.health


@pytest.mark.parametrize(
    ("setpoint_m", "cause", "health", "expected"),
    [
        (
            HERE_M - 0.01,
            Cause.DEVIATION,
            Health.FAILURE,
            "the stem is 10.0 mm above its setpoint of 70.0 mm and came no nearer",
        ),
        (
            HERE_M + 0.01,
            Cause.SETPOINT_UNREACHABLE,
            Health.OUT_OF_SPECIFICATION,
            "out of reach: 20 mA do not move it from 80.0 mm, by a stiffer",
        ),
        (
            0.127,
            Cause.SETPOINT_UNREACHABLE,
            Health.OUT_OF_SPECIFICATION,
            "which is out of reach: 20 mA open it to 99.9 mm",
        ),
    ],
)
def test_a_stem_that_stays_away_is_reported_once_and_out_of_specification(
    tmp_path: Path, setpoint_m: float, cause: Cause, health: Health, expected: str
) -> None:
    # a stem that stays although 1.5 times its friction pushes it is stuck, which is a failure of the valve
    with Loop(tmp_path, control={"law": "pi"}, guard={"frozen_s": 0.0}) as loop:
        loop.request(HostRequest.ARM)
        assert trouble(last_status(loop, 100, HERE_M)) == (Mode.ACTIVE, Cause.NONE, Health.GOOD)
        assert trouble(last_status(loop, 70, setpoint_m)) == (Mode.ACTIVE, Cause.NONE, Health.GOOD)
        told = [trouble(last_status(loop, 30, setpoint_m)) for _ in range(3)]
        assert told[0] == (Mode.ACTIVE, cause, Health.OUT_OF_SPECIFICATION)
        assert told[1:] == [(Mode.ACTIVE, cause, health)] * 2
        assert len(loop.logged("deviation: ")) == 1
        assert expected in loop.logged("deviation: ")[0]
        assert trouble(last_status(loop, 30, setpoint_m, setpoint_m)) == (Mode.ACTIVE, Cause.NONE, Health.GOOD)


def test_a_stem_that_is_not_under_control_is_away_from_nothing(tmp_path: Path) -> None:
    with Loop(tmp_path, control={"law": "pi"}) as loop:
        for _ in range(150):
            loop.sample(HERE_M, 0.127)
        assert not loop.logged("deviation")
        loop.request(HostRequest.ARM)
        for _ in range(150):
            loop.sample(HERE_M, 0.127)
        assert loop.logged("deviation")
        loop.request(HostRequest.DISARM)
        assert loop.session.state.deviation.cause is Cause.NONE
