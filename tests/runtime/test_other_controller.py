"""Another controller on the bus, and the last frames of one that has ended."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import pytest
from daemon_helpers import PERIOD_S, Loop

from positioner.errors import AnotherControllerError, ExitCode
from positioner.runtime.other_controller import GOES_ON_NS, OtherController
from positioner.wire.messages import CurrentCommand, HostRequest, Mode

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

QUEUE_FRAMES = 1000
"""The longest transmit queue that anybody sets; the kernel's own is 10, ours is 128."""
FRAME_NS = {1_000_000: 135_000, 125_000: 1_080_000}
"""How long a frame of eight bytes takes at most, by the bitrate."""


@pytest.fixture
def loop(tmp_path: Path) -> Iterator[Loop]:
    """A daemon that waits to be armed."""
    with Loop(tmp_path) as made:
        yield made


@pytest.mark.parametrize("frame_ns", FRAME_NS.values(), ids=[f"{rate} bit/s" for rate in FRAME_NS])
def test_a_queue_that_drains_is_no_controller(frame_ns: int) -> None:
    other = OtherController()
    for start_ns in (0, 5_000_000_000):  # and once more, after the bus was away
        assert not any(other.goes_on(start_ns + number * frame_ns) for number in range(QUEUE_FRAMES))


@pytest.mark.parametrize("period_ms", [1, 10, 100, 900])
def test_who_goes_on_for_two_seconds_is_another_controller(period_ms: int) -> None:
    other, now_ns = OtherController(), 7_000_000_000
    first_ns = now_ns
    while not other.goes_on(now_ns):
        now_ns += period_ms * 1_000_000
    assert GOES_ON_NS <= now_ns - first_ns < GOES_ON_NS + period_ms * 1_000_000


@pytest.mark.bus
def test_the_last_frames_of_a_daemon_that_was_killed_do_not_end_the_next_one(loop: Loop) -> None:
    loop.sample()
    for _ in range(6):
        loop.cycle(*(loop.others.frame(CurrentCommand(9.5)) for _ in range(128)), after_s=0.02)
    assert len(loop.logged("another controller")) == 1
    loop.request(HostRequest.ARM)
    assert [m for m in loop.sample() if isinstance(m, CurrentCommand)] == []  # not within a second
    for _ in range(60):
        loop.request(HostRequest.NONE)
    (command, *_) = loop.request(HostRequest.ARM)
    assert isinstance(command, CurrentCommand)
    assert command.mode is Mode.ACTIVE


@pytest.mark.bus
def test_another_controller_that_goes_on_ends_it_before_it_sends_a_frame(loop: Loop) -> None:
    loop.sample()
    cycles = itertools.count()
    with pytest.raises(AnotherControllerError, match=r"not started: another controller .* \(9.500 mA\)") as caught:
        cycle_while_another_commands(loop, cycles)
    assert caught.value.exit_code is ExitCode.UNAVAILABLE
    assert next(cycles) * PERIOD_S == pytest.approx(GOES_ON_NS / 1e9, abs=2.0 * PERIOD_S)
    assert loop.others.listen() == []


def cycle_while_another_commands(loop: Loop, cycles: Iterator[int]) -> None:
    while next(cycles) < 1000:
        loop.cycle(loop.others.frame(CurrentCommand(9.5)))
