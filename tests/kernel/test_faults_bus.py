"""Faults of the bus itself, made by the kernel's own queueing disciplines and links, around a valve that runs."""

from __future__ import annotations

import printed
import pytest
from links import command
from rig import CLOSED_M, HIGH_M, LOW_M, Rig
from slow_cases import slow

from positioner.wire.messages import CurrentCommand, Mode

pytestmark = pytest.mark.kernel("faults")


def disturb(rig: Rig, *discipline: str) -> None:
    command("tc", "qdisc", "replace", "dev", rig.bus.channel, "root", *discipline)


def calm(rig: Rig) -> None:
    command("tc", "qdisc", "delete", "dev", rig.bus.channel, "root")


@pytest.mark.parametrize(
    ("discipline", "word"),
    [
        (("netem", "loss", "10%"), printed.LOST),
        *slow(
            (("netem", "duplicate", "30%"), printed.REPEATED),
            (("netem", "delay", "15ms", "reorder", "50%", "50%"), printed.OUT_OF_ORDER),
        ),
        (("netem", "corrupt", "20%"), printed.WRONG_CRC),
    ],
    ids=["loss", "duplication", "reordering", "corruption"],
)
def test_a_bad_bus_is_counted_and_the_valve_stays_controlled(rig: Rig, discipline: tuple[str, ...], word: str) -> None:
    disturb(rig, *discipline)
    rig.until(lambda: rig.logged(word))
    # frames still come through, and the stem still goes where it is asked to
    rig.go_to(LOW_M)
    rig.go_to(HIGH_M)
    calm(rig)
    rig.after(5)
    assert rig.mode() is Mode.ACTIVE
    assert not rig.logged(printed.TRACEBACK)


@pytest.mark.slow(short="test_a_bad_bus_is_counted_and_the_valve_stays_controlled")
def test_the_valve_stays_controlled_with_a_delay_of_a_period(rig: Rig) -> None:
    disturb(rig, "netem", "delay", "20ms", "5ms")
    rig.go_to(LOW_M)
    rig.go_to(HIGH_M)
    calm(rig)
    rig.after(5)
    assert rig.mode() is Mode.ACTIVE


@pytest.mark.slow(
    short="runtime/test_safety_bus.py::test_a_frame_that_the_bus_does_not_take_is_reported_once_and_the_next_one_is_sent"
)
def test_a_bus_that_takes_no_frames_is_logged_and_comes_back(rig: Rig) -> None:
    disturb(rig, "tbf", "rate", "800bit", "burst", "64", "limit", "64")
    rig.until(lambda: rig.logged(printed.NOT_TAKEN))
    assert any(printed.NO_BUFFER_SPACE in line for line in rig.logged(printed.NOT_TAKEN))
    calm(rig)
    rig.until(lambda: rig.mode() in {Mode.ACTIVE, Mode.HOLD, Mode.FAILSAFE})
    rig.go_to(LOW_M)
    assert rig.mode() is Mode.ACTIVE


def test_a_link_that_goes_down_fails_safe_on_both_sides_and_waits_to_be_armed(rig: Rig) -> None:
    command("ip", "link", "set", rig.bus.channel, "down")
    rig.until(lambda: rig.logged(printed.INTO_FAILSAFE))
    assert rig.logged(printed.HELD_BY_FEEDBACK)
    assert rig.logged(printed.BUS_DOWN)
    command("ip", "link", "set", rig.bus.channel, "up")
    rig.received.newest.clear()
    # the actuator's own deadman has closed the valve meanwhile, and FAILSAFE keeps it there
    rig.until(lambda: rig.is_at(CLOSED_M, 0.002))
    rig.after(20)
    assert rig.mode() is Mode.FAILSAFE
    assert rig.next(CurrentCommand).current_ma == 4.0
    rig.arm()
    rig.go_to(HIGH_M)


@pytest.mark.slow(short="test_a_link_that_goes_down_fails_safe_on_both_sides_and_waits_to_be_armed")
def test_a_link_that_is_deleted_and_made_again_is_found_again(rig: Rig) -> None:
    name = rig.bus.channel
    command("ip", "link", "delete", name)
    rig.until(lambda: rig.logged(printed.INTO_FAILSAFE))
    command("ip", "link", "add", "dev", name, "type", "vcan")
    command("ip", "link", "set", name, "up")
    rig.received.newest.clear()
    rig.until(lambda: rig.logged(printed.BUS_BACK))
    rig.until(lambda: rig.is_at(CLOSED_M, 0.002))
    assert rig.daemon.process.poll() is None
    rig.arm()
    rig.go_to(HIGH_M)
