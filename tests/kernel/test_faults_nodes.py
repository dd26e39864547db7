"""Faults of the nodes around a valve that runs: a flood, a second controller, a stepped clock, a node that hangs."""

from __future__ import annotations

import datetime as dt
import time
from typing import TYPE_CHECKING

import printed
import pytest
from links import TIMEOUT_S, Program, command
from rig import CLOSED_M, DEADMAN_S, FAILSAFE_PERIODS, HIGH_M, HOLD_PERIODS, LOW_M, PERIOD_S, Rig

from positioner.wire.messages import Cause, CurrentCommand, Health, Mode, PlantTruth, PositionerStatus

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.kernel("faults")


@pytest.mark.slow(
    short="runtime/test_safety_bus.py::test_a_flood_is_taken_in_batches_of_at_most_1024_frames_between_which_a_cycle_closes"
)
def test_a_flood_of_higher_priority_does_not_reach_the_positioner(rig: Rig, tmp_path: Path) -> None:
    before = len(rig.logged(printed.MODE))
    words = ["cangen", rig.bus.channel, "-g", "0.5", "-I", "001", "-L", "8", "-n", "4000"]
    with Program(words, tmp_path / "cangen.log") as flood:
        rig.go_to(LOW_M)
        rig.until(lambda: flood.process.poll() is not None, TIMEOUT_S * 2)
    rig.after(5)
    assert not rig.logged(printed.QUEUE_FULL)
    assert not rig.logged(printed.REFUSED)
    assert rig.mode() is Mode.ACTIVE
    assert len(rig.logged(printed.MODE)) >= before
    rig.go_to(HIGH_M)


@pytest.mark.slow(
    short="runtime/test_daemon.py::test_another_controller_after_arming_is_reported_and_shown_and_the_loop_goes_on"
)
def test_a_second_controller_is_an_alarm_for_as_long_as_it_speaks(rig: Rig) -> None:
    numbers = iter(range(100_000))
    rig.after(15, PositionerStatus)  # within a second after the arming it means that one ARM has armed two

    def status_while_it_speaks() -> PositionerStatus | None:
        rig.port.send(rig.codec.encode(CurrentCommand(12.5), next(numbers)))
        return rig.newest(PositionerStatus)

    rig.until(lambda: (status := status_while_it_speaks()) is not None and status.cause is Cause.FOREIGN_COMMAND)
    status = rig.newest(PositionerStatus)
    assert status is not None
    assert (status.mode, status.health) == (Mode.ACTIVE, Health.FAILURE)
    assert any(printed.foreign(12.5) in line for line in rig.lines)
    rig.until(lambda: (status := rig.newest(PositionerStatus)) is not None and status.cause is Cause.NONE)
    assert rig.next(PositionerStatus).health is Health.GOOD


@pytest.mark.slow(short="guard/test_stall.py::test_a_step_of_the_wall_clock_makes_nothing_fresh_old")
def test_a_clock_that_is_stepped_by_an_hour_changes_nothing(rig: Rig) -> None:
    modes = len(rig.logged(printed.MODE))
    for step in (1, -2):
        now = dt.datetime.now(tz=dt.UTC) + dt.timedelta(hours=step)
        command("date", "-u", "-s", now.strftime("%Y-%m-%d %H:%M:%S"))
        rig.after(30)
        assert rig.mode() is Mode.ACTIVE
    assert len(rig.logged(printed.MODE)) == modes
    rig.go_to(LOW_M)


def test_a_positioner_that_hangs_leaves_the_valve_to_its_own_deadman(rig: Rig) -> None:
    rig.pause(rig.daemon)
    rig.until(lambda: rig.is_at(CLOSED_M, 0.002))
    rig.resume(rig.daemon)
    rig.received.newest.clear()
    rig.after(5)
    rig.go_to(HIGH_M)
    assert rig.mode() is Mode.ACTIVE


def test_a_valve_that_is_silent_is_held_then_failed_safe_until_it_is_armed_again(rig: Rig) -> None:
    last = rig.next(CurrentCommand)
    silent_s = time.monotonic()
    rig.pause(rig.plant)
    rig.received.newest.clear()
    rig.until(lambda: (newest := rig.newest(CurrentCommand)) is not None and newest.mode is Mode.HOLD)
    # the last reading may be some periods old when the emulator is stopped: this kernel is slow
    assert HOLD_PERIODS / 2 <= (time.monotonic() - silent_s) / PERIOD_S < FAILSAFE_PERIODS
    held = rig.newest(CurrentCommand)
    assert held is not None
    assert held.current_ma == pytest.approx(last.current_ma, abs=2.0)
    rig.until(lambda: rig.mode() is Mode.FAILSAFE)
    assert FAILSAFE_PERIODS - HOLD_PERIODS / 2 <= (time.monotonic() - silent_s) / PERIOD_S < 5 * FAILSAFE_PERIODS
    status = rig.newest(PositionerStatus)
    assert status is not None
    assert (status.cause, status.health) == (Cause.FEEDBACK_STALE, Health.FAILURE)
    assert rig.next(CurrentCommand).current_ma == 4.0
    rig.resume(rig.plant)
    rig.received.newest.pop(PlantTruth, None)
    rig.until(lambda: rig.is_at(CLOSED_M, 0.002), TIMEOUT_S + DEADMAN_S)
    assert rig.mode() is Mode.FAILSAFE
    rig.arm()
    rig.go_to(LOW_M)
