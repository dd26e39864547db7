"""Stalls: no old reading is acted on, a long one fails safe and is reported, and its record replays to the bit."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any

import pytest
from virtual_shell import VirtualShell

from positioner.cli.main import main
from positioner.runtime.session import RunOptions
from positioner.wire.messages import Cause, Counted, CurrentCommand, HostRequest, Mode, PositionerStatus

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

MS = 1_000_000
PERIOD_MS = 10
HOLD_MS, FAILSAFE_MS = 30, 100


@pytest.fixture
def shell(tmp_path: Path) -> Iterator[VirtualShell]:
    with VirtualShell(tmp_path) as shell:
        shell.arm()
        assert shell.mode() is Mode.ACTIVE
        shell.lines.clear()
        yield shell


def once(at: int, stall_ms: float) -> Callable[[], int]:
    """Return a function that stalls at the `at`-th place from now, once."""
    places = iter(range(at + 1))

    def struck() -> int:
        return round(stall_ms * MS) if next(places, None) == at else 0

    return struck


def once_what(strike: Callable[[], int]) -> Callable[[], int]:
    """Return a function that calls `strike` at the next place, once."""
    strikes = iter([strike])

    def struck() -> int:
        strike = next(strikes, None)
        return strike() if strike else 0

    return struck


def oldest_answer_ms(shell: VirtualShell) -> float:
    """Return the largest age in ms of a reading when its command was sent; in HOLD no new current may be sent."""
    ages, last_ma = [], 0.0
    for each in shell.world.sent:
        if not isinstance(each.message, CurrentCommand):
            continue
        if each.message.mode is Mode.HOLD:
            assert each.message.current_ma == last_ma
        elif each.message.mode is Mode.ACTIVE and each.answered_ns:
            ages.append((each.at_ns - each.answered_ns) / MS)
        last_ma = each.message.current_ma
    return max(ages)


PLACES = range(12)
"""Where in a cycle a stall may strike: before each look at the clock, and while waiting."""


@pytest.mark.parametrize("stall_ms", [FAILSAFE_MS + 1, 400, 6_600, 60_000])
def test_a_stall_beyond_the_failsafe_limit_is_latched_and_reported_wherever_it_strikes(
    stall_ms: float, shell: VirtualShell
) -> None:
    for place in PLACES:
        shell.arm()
        shell.cycle_for(1.0)  # a line of each kind is logged once a second
        assert shell.mode() is Mode.ACTIVE
        shell.lines.clear()
        shell.world.struck = once(place, stall_ms)
        shell.cycle_for(stall_ms / 1e3 + 0.5)
        mode, cause = shell.mode_and_cause()
        assert mode is Mode.FAILSAFE
        assert cause in {Cause.STALLED, Cause.FEEDBACK_STALE}
        assert len(shell.logged("-> FAILSAFE")) == 1
        assert shell.logged("stood still for")
        commands = [each.message for each in shell.world.sent if isinstance(each.message, CurrentCommand)]
        assert (commands[-1].mode, commands[-1].current_ma) == (Mode.FAILSAFE, 4.0)
    assert oldest_answer_ms(shell) <= HOLD_MS


@pytest.mark.parametrize("stall_ms", [HOLD_MS + 1, 60, 89])
def test_a_stall_beyond_the_hold_limit_holds_for_a_cycle_and_is_reported(stall_ms: float, shell: VirtualShell) -> None:
    for place in PLACES:
        shell.cycle_for(1.0)
        shell.lines.clear()
        before = len(shell.world.sent)
        shell.world.struck = once(place, stall_ms)
        shell.cycle_for(stall_ms / 1e3 + 0.5)
        assert shell.mode() is Mode.ACTIVE
        assert len(shell.logged("stood still for")) == 1
        messages = [each.message for each in shell.world.sent[before:]]
        assert Mode.HOLD in {message.mode for message in messages if isinstance(message, CurrentCommand)}
        assert shell.session.state.counters.by_cause[Counted.STALLED] == place + 1
    assert oldest_answer_ms(shell) <= HOLD_MS


def test_after_a_stall_the_last_command_comes_before_any_new_one(shell: VirtualShell) -> None:
    before = len(shell.world.sent)
    shell.world.struck = once(0, 60.0)
    shell.cycle()
    modes = [each.message.mode for each in shell.world.sent[before:] if isinstance(each.message, CurrentCommand)]
    assert modes[0] is Mode.HOLD
    assert shell.session.state.link.feedback.periods_unread > 0  # the law will know how much time has passed


NEVER_FAILS = {"feedback_failsafe_periods": 10_000, "setpoint_hold_s": 0.0, "setpoint_failsafe_s": 0.0}
"""No stall fails safe, so that the commands after it show which readings are acted on."""


def test_readings_that_waited_in_a_long_queue_are_not_acted_on(tmp_path: Path) -> None:
    with VirtualShell(tmp_path, guard=NEVER_FAILS) as shell:
        shell.arm()
        shell.world.struck = once(0, 60_000.0)  # more than one batch is queued, and only the first is taken after a gap
        shell.cycle_for(61.0)
        assert shell.mode() is Mode.ACTIVE
        assert oldest_answer_ms(shell) <= HOLD_MS


def test_a_short_stall_is_a_late_cycle_and_no_more(shell: VirtualShell) -> None:
    shell.world.struck = once(5, 15.0)
    shell.cycle_for(0.5)
    assert shell.logged("longer than the period of 10 ms")
    assert not shell.logged("stood still")
    assert shell.mode() is Mode.ACTIVE


def test_without_a_stall_nothing_is_reported_and_every_reading_is_answered_at_once(shell: VirtualShell) -> None:
    shell.cycle_for(2.0)
    assert shell.lines == []
    assert oldest_answer_ms(shell) < 1.0


@pytest.mark.parametrize("stamps", [True, False])
@pytest.mark.parametrize("step_s", [-3600.0, -0.5, 0.5, 3600.0])
def test_a_step_of_the_wall_clock_makes_nothing_fresh_old(step_s: float, stamps: bool, shell: VirtualShell) -> None:
    shell.world.stamps = stamps
    for step_ns in (0, round(step_s * 1e9)):
        shell.world.wall_step_ns += step_ns
        shell.cycle_for(0.2)
        assert shell.mode() is Mode.ACTIVE
        assert shell.lines == []
    shell.world.struck = once(2, 5_000.0)
    shell.cycle_for(5.5)
    assert shell.mode() is Mode.FAILSAFE
    assert oldest_answer_ms(shell) <= HOLD_MS


@pytest.mark.parametrize("stamps", [True, False])
def test_a_step_of_the_wall_clock_makes_nothing_old_fresh(stamps: bool, tmp_path: Path) -> None:
    with VirtualShell(tmp_path, guard=NEVER_FAILS) as shell:
        shell.arm()
        world = shell.world
        world.stamps = stamps

        def strike() -> int:
            world.pass_time(60_000 * MS)
            # the last frame of the second batch seems to have come just now
            world.wall_step_ns -= world.now_ns - world.queue[2 * 1024 - 1].at_ns - PERIOD_MS * MS
            return 0

        world.struck = once_what(strike)
        shell.cycle_for(62.0)
        assert shell.mode() is Mode.ACTIVE
        assert oldest_answer_ms(shell) <= HOLD_MS


def test_an_arm_that_was_asked_during_a_stall_does_not_undo_the_latch(shell: VirtualShell) -> None:
    world = shell.world

    def strike() -> int:
        for request in (HostRequest.NONE, HostRequest.ARM):
            world.pass_time(20_000 * MS)
            world.request = request
        return 10_000 * MS

    world.struck = once_what(strike)
    shell.cycle_for(51.0)
    assert shell.mode_and_cause() == (Mode.FAILSAFE, Cause.STALLED)
    shell.arm()
    assert shell.mode() is Mode.ACTIVE


@pytest.mark.parametrize(("waited_ms", "arms"), [(7_400.0, False), (FAILSAFE_MS + 10, False), (FAILSAFE_MS - 10, True)])
def test_an_arm_that_waited_in_the_queue_of_a_stopped_positioner_does_not_arm_it(
    waited_ms: float, arms: bool, tmp_path: Path
) -> None:
    with VirtualShell(tmp_path) as shell:
        shell.cycle_for(0.5)
        assert shell.mode() is Mode.READY
        stopped_ns, world = shell.world.now_ns, shell.world
        # the host sends a setpoint every 100 ms: five with NONE, one with ARM after 510 ms, and no more
        instants_ms = (0, 450, 550)
        requests = (HostRequest.NONE, HostRequest.ARM, None)
        world.asks.extend((stopped_ns + ms * MS, request) for ms, request in zip(instants_ms, requests, strict=True))
        world.struck = once(0, 510.0 + waited_ms)
        shell.cycle_for(9.0)
        commands = [each for each in world.sent if isinstance(each.message, CurrentCommand)]
        assert bool(commands) is arms
        if not arms:
            assert shell.mode() is Mode.READY
            world.request = HostRequest.ARM  # the same request again: used up
            shell.cycle_for(0.5)
            assert shell.mode() is Mode.READY
            shell.arm()
            assert shell.mode() is Mode.ACTIVE


def test_a_disarm_that_was_asked_during_a_stall_disarms(shell: VirtualShell) -> None:
    shell.world.request = HostRequest.DISARM
    shell.world.struck = once(3, 500.0)
    shell.cycle_for(1.0)
    assert shell.mode() is Mode.READY


def test_a_law_that_is_always_too_late_to_be_used_fails_safe(
    shell: VirtualShell, monkeypatch: pytest.MonkeyPatch
) -> None:
    law: Any = type(shell.session.setup.law)
    decide = law.decide

    def slow(*arguments: Any) -> Any:
        shell.world.pass_time(45 * MS)
        return decide(*arguments)

    monkeypatch.setattr(law, "decide", slow)
    shell.cycle_for(3.0)
    assert shell.mode_and_cause() == (Mode.FAILSAFE, Cause.LAW_LATE)
    commands = [each for each in shell.world.sent if isinstance(each.message, CurrentCommand)]
    # the last command is repeated in between, as a sign of life for the actuator
    assert max((other.at_ns - one.at_ns) / MS for one, other in pairwise(commands)) < FAILSAFE_MS
    assert oldest_answer_ms(shell) <= HOLD_MS


def test_a_stall_before_arming_is_not_reported(tmp_path: Path) -> None:
    with VirtualShell(tmp_path) as shell:
        shell.cycle_for(0.5)
        shell.world.struck = once(3, 5_000.0)
        shell.cycle_for(6.0)
        assert shell.mode() is Mode.READY
        assert not shell.logged("stood still")
        shell.arm()
        assert shell.mode() is Mode.ACTIVE


@pytest.mark.slow(short="test_a_stall_beyond_the_failsafe_limit_is_latched_and_reported_wherever_it_strikes")
def test_a_record_with_stalls_replays_to_the_bit(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = tmp_path / "bus.log"
    with VirtualShell(tmp_path, options=RunOptions(record=log)) as shell:
        for stall_ms in (4.0, 15.0, 60.0, 95.0, 700.0):
            for place in range(12):
                shell.arm()
                shell.world.struck = once(place, stall_ms)
                shell.cycle_for(0.05 + stall_ms / 1e3)
        causes = {each.message.cause for each in shell.world.sent if isinstance(each.message, PositionerStatus)}
        assert Cause.STALLED in causes
    assert main(["replay", str(log), "--config", str(tmp_path / "valve.toml")]) == 0
    assert "identical" in capsys.readouterr().out
    # without the recorded ages, or without the gaps, the replay differs
    for kind in ("FD", "01"):
        kept = [
            line
            for line in log.read_text(encoding="ascii").splitlines(keepends=True)
            if f" 1FFFFFFF#{kind}" not in line
        ]
        part = tmp_path / f"without-{kind}.log"
        part.write_text("".join(kept), encoding="ascii")
        assert main(["replay", str(part), "--config", str(tmp_path / "valve.toml")]) == 1
