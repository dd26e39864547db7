"""The measured sample period, a lockstep whose plant does not wait, and how often the actuator gets a command."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import pytest
from daemon_helpers import Loop, write_configuration
from virtual_shell import VirtualShell

from positioner.bus.address import BusAddress
from positioner.cli.main import main
from positioner.errors import ExitCode, UsageError
from positioner.runtime.lockstep import LockstepClock
from positioner.runtime.session import RunOptions
from positioner.wire.messages import Cause, CurrentCommand, Health, Mode, PositionerStatus, StemPosition

if TYPE_CHECKING:
    from pathlib import Path

MS = 1_000_000


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_a_wrong_sample_period_is_reported_with_the_measured_one(factor: float, tmp_path: Path) -> None:
    with VirtualShell(tmp_path) as shell:
        shell.world.period_ns = round(factor * shell.world.period_ns)
        shell.cycle_for(2.0)
        assert len(shell.logged(f"position frames come every {factor * 10:g} ms, and control.sample_period_s")) >= 1
        shell.arm()
        shell.cycle_for(1.0)
        assert shell.mode_and_cause() == (Mode.ACTIVE, Cause.PERIOD_WRONG)
        status = [each.message for each in shell.world.sent if isinstance(each.message, PositionerStatus)][-1]
        assert (status.cause, status.health) == (Cause.PERIOD_WRONG, Health.OUT_OF_SPECIFICATION)


def test_lockstep_with_a_plant_that_does_not_wait_ends_in_one_line(tmp_path: Path) -> None:
    with Loop(tmp_path, RunOptions(lockstep=True)) as loop:
        loop.session.clock = LockstepClock(loop.others.codec, 0.02)
        for _ in range(3):
            sent = loop.cycle(loop.others.frame(StemPosition(0.08)))
            assert not any(isinstance(message, CurrentCommand) for message in sent)
        with pytest.raises(
            UsageError, match="4 position frames came without an answer: this plant does not wait"
        ) as end:
            loop.cycle(loop.others.frame(StemPosition(0.08)))
        assert end.value.exit_code is ExitCode.USAGE


def test_lockstep_with_a_plant_that_waits_and_sends_its_reading_again_goes_on(tmp_path: Path) -> None:
    with Loop(tmp_path, RunOptions(lockstep=True)) as loop:
        loop.session.clock = LockstepClock(loop.others.codec, 0.02)
        again = loop.others.frame(StemPosition(0.08))
        for _ in range(20):
            assert not any(isinstance(message, CurrentCommand) for message in loop.cycle(again))


@pytest.mark.parametrize("period_s", [0.001, 0.007, 0.2])
def test_in_hold_the_last_command_comes_every_ten_milliseconds_whatever_the_period(
    period_s: float, tmp_path: Path
) -> None:
    never_fails = {"feedback_failsafe_periods": 10_000, "setpoint_hold_s": 0.0, "setpoint_failsafe_s": 0.0}
    with VirtualShell(tmp_path, period_s, guard=never_fails) as shell:
        shell.arm()
        shell.world.plant_silent = True
        shell.cycle_for(4 * period_s)
        before = len(shell.world.sent)
        shell.cycle_for(1.0)
        held = [each for each in shell.world.sent[before:] if isinstance(each.message, CurrentCommand)]
        assert {each.message.mode for each in held if isinstance(each.message, CurrentCommand)} == {Mode.HOLD}
        gaps_ms = [(other.at_ns - one.at_ns) / MS for one, other in pairwise(held)]
        assert 10.0 <= min(gaps_ms) <= max(gaps_ms) <= 20.0
        assert len(held) >= 50


@pytest.mark.parametrize(
    ("period_s", "guard", "expected"),
    [
        (0.033, {}, "\nactuator's deadman     100 ms\n"),
        (0.034, {}, "\n- FV-101: the sample period is too long for the actuator's deadman of 100 ms: beyond 33.3 ms"),
        (0.2, {"actuator_deadman_s": 0.601}, "\nactuator's deadman     601 ms\n"),
        (0.2, {"actuator_deadman_s": 0.0}, "\nactuator's deadman     none\n"),
    ],
)
def test_check_reports_when_the_sample_period_is_too_long_for_the_deadman(
    period_s: float, guard: dict[str, float], expected: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bus = BusAddress(interface="virtual", channel="none")
    path = write_configuration(tmp_path, bus, control={"sample_period_s": period_s}, guard=guard)
    assert main(["check", str(path)]) == 0
    assert expected in capsys.readouterr().out
