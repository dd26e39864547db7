"""A stem that hunts under the daemon on a bus: the log, the status, the alarm of health, and the words of a host."""

from __future__ import annotations

from typing import TYPE_CHECKING

from daemon_helpers import HERE_M, PERIOD_S, Loop

from positioner.health.causes import AlarmCause
from positioner.host.words import CAUSES, alarms_in_words, state_in_words
from positioner.wire.messages import (
    Cause,
    Health,
    HostRequest,
    Mode,
    PositionerAlarms,
    PositionerStatus,
    Setpoint,
    StemPosition,
)

if TYPE_CHECKING:
    from pathlib import Path

SWING_M, HALF_S = 0.01, 0.3
BIT = 1 << AlarmCause.HUNTING


def test_a_stem_that_hunts_is_told_within_five_seconds_with_count_and_amplitude(tmp_path: Path) -> None:
    """The integrator of `pi` follows the swings of the stem, which goes to and fro around its setpoint."""
    with Loop(tmp_path, control={"law": "pi"}) as loop:
        loop.request(HostRequest.ARM)
        told: list[tuple[float, PositionerStatus]] = []
        alarms: list[tuple[float, PositionerAlarms]] = []
        for number in range(round(9.0 / PERIOD_S)):
            time_s = number * PERIOD_S
            away_m = (1 if int(time_s / HALF_S) % 2 else -1) * SWING_M / 2.0 if time_s < 6.0 else 0.0
            reading = loop.others.frame(StemPosition(HERE_M + away_m + 1e-6 * (number % 5), loop.others.acting))
            for message in loop.cycle(loop.others.frame(Setpoint(HERE_M)), reading):
                if isinstance(message, PositionerStatus):
                    told.append((time_s, message))
                if isinstance(message, PositionerAlarms):
                    alarms.append((time_s, message))
        first_s, status = next((time_s, each) for time_s, each in told if each.cause is Cause.HUNTING)
        assert 4.5 < first_s < 5.2
        assert (status.mode, status.health) == (Mode.ACTIVE, Health.OUT_OF_SPECIFICATION)
        assert state_in_words(status).startswith(f"ACTIVE: {CAUSES[Cause.HUNTING]}")
        assert told[-1][1].cause is Cause.NONE  # it has rested for 3 s
        (line,) = [line for line in loop.logged("the stem hunts: ") if line.startswith("the")]
        assert "reversals in 4." in line
        alarm_s, alarm = next((time_s, each) for time_s, each in alarms if each.active & BIT)
        assert alarm_s < 5.6
        assert alarm.worst is Health.OUT_OF_SPECIFICATION
        assert alarms_in_words(alarm).startswith("hunting (new)")
        assert not alarms[-1][1].active & BIT
        (came,) = loop.logged("alarm: the stem hunts: ")
        assert "% of span, limit 3 (out of specification)" in came
        assert loop.logged("alarm over: the stem hunts")
