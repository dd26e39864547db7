"""The window over the counters of one identifier: with one sender, on a bad bus, and with two senders."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

import pytest

from positioner.wire.e2e import CounterCheck, Sequence
from positioner.wire.window import CLEAN_FRAMES, MAX_ERRORS, WINDOW_FRAMES, Sender, SequenceWindow

if TYPE_CHECKING:
    from collections.abc import Iterable


def window_after(errors: Iterable[bool]) -> SequenceWindow:
    window = SequenceWindow()
    for error in errors:
        window = window.after(error=error)
    return window


def receive_all(frames: Iterable[tuple[int, bytes]], modulus: int = 256) -> tuple[Sender, list[bytes]]:
    """Return the sender after frames of these counters and bytes, and the bytes that a reading would be taken from."""
    sender, taken = Sender(CounterCheck(modulus=modulus)), []
    for counter, data in frames:
        sender, verdict, _ = sender.receive(counter % modulus, data)
        if verdict is Sequence.FRESH and sender.window.settled:
            taken.append(data)
    return sender, taken


def test_a_sender_that_counts_on_is_always_believed() -> None:
    frames = [(count, b"%d" % count) for count in range(1000)]
    sender, taken = receive_all(frames)
    assert (sender.window, len(taken)) == (SequenceWindow(), 1000)


@pytest.mark.parametrize("spacing", [16, 17, 64])
def test_four_errors_in_sixty_four_frames_are_a_dispute_and_fewer_are_none(spacing: int) -> None:
    assert (WINDOW_FRAMES, MAX_ERRORS) == (64, 3)
    errors = [number % spacing == 0 for number in range(1000)]
    assert window_after(errors).valid is (spacing > 16)
    assert window_after([True] * 3).valid
    assert not window_after([True] * 4).valid


def test_sixteen_frames_in_sequence_end_a_dispute_and_fifteen_do_not() -> None:
    assert CLEAN_FRAMES == 16
    disputed = [True] * 4
    assert not window_after([*disputed, *[False] * 15]).valid
    assert window_after([*disputed, *[False] * 16]) == SequenceWindow()
    assert not window_after([*disputed, *[False] * 15, True, *[False] * 15]).valid


def test_after_one_error_a_reading_waits_for_the_second_frame_in_sequence() -> None:
    assert not window_after([True]).settled
    assert not window_after([True, False]).settled
    assert window_after([True, False, False]).settled
    assert window_after([True, False]).valid


@pytest.mark.parametrize("modulus", [256, 16])
def test_a_sender_that_restarts_every_now_and_then_is_believed_again(modulus: int) -> None:
    frames = [(count - 5 * (count // 100), b"%d" % count) for count in range(1000)]
    sender, taken = receive_all(frames, modulus)
    assert sender.window.valid
    assert len(taken) == 1000 - 2 * 9  # at each restart one is refused, and the second one waits


def test_frames_that_came_twice_and_frames_that_were_overtaken_are_no_errors() -> None:
    frames = [(count, b"%d" % count) for count in range(501)]
    doubled = [frame for frame in frames for _ in range(2)]
    swapped = [frames[0], *(frames[1 + (index ^ 1)] for index in range(500))]
    for received_frames, expected in ((doubled, 501), (swapped, 251)):
        sender, taken = receive_all(received_frames)
        assert sender.window == SequenceWindow()
        assert len(taken) == expected


def test_a_bus_that_delays_every_second_frame_is_no_dispute() -> None:
    """The bus is like netem with `delay 15ms reorder 50%`, for frames 10 ms apart."""
    chance = random.Random(3)  # noqa: S311 - a bus that can be repeated, no secret
    sent = [(10.0 * count + 15.0 * (chance.random() < 0.5), count) for count in range(2000)]
    sender, taken = receive_all((count, b"%d" % count) for _, count in sorted(sent))
    assert sender.window == SequenceWindow()
    assert len(taken) > 1000


@pytest.mark.parametrize("ahead", [*range(1, 256), -1])
def test_of_two_senders_that_alternate_neither_is_believed_for_long(ahead: int) -> None:
    """A second one that is just ahead is believed while its steps can be losses: four times at most."""
    frames = [(count + ahead * which, b"AB"[which : which + 1]) for count in range(500) for which in range(2)]
    sender, taken = receive_all(frames)
    assert not sender.window.valid
    assert taken.count(b"A") <= 1
    assert taken.count(b"B") <= 4


@pytest.mark.parametrize("seed", range(20))
def test_of_two_senders_neither_is_believed_when_the_first_loses_frames(seed: int) -> None:
    chance = random.Random(seed)  # noqa: S311 - a bus that can be repeated, no secret
    ahead = chance.randrange(256)
    sent = [(count + ahead * which, b"AB"[which : which + 1]) for count in range(2000) for which in range(2)]
    sender, taken = receive_all(frame for frame in sent if frame[1] == b"B" or chance.random() < 0.99)
    assert not sender.window.valid
    assert taken.count(b"B") <= 4


@pytest.mark.parametrize("every", [2, 5, 10, 15])
def test_a_slower_second_sender_is_seen_down_to_a_fifteenth_of_the_rate(every: int) -> None:
    frames: list[tuple[int, bytes]] = []
    for count in range(2000):
        frames.append((count, b"A"))
        if count % every == 0:
            frames.append((100 + count // every, b"B"))
    assert not receive_all(frames)[0].window.valid


def test_a_frame_of_the_same_count_and_other_bytes_is_a_second_senders() -> None:
    frames = [(count, data) for count in range(10) for data in (b"A", b"B")]
    assert not receive_all(frames)[0].window.valid


def test_the_reason_is_reported_in_words() -> None:
    assert window_after([True]).why == "its sender is in doubt: a frame came out of sequence just before"
    assert window_after([True] * 5).why == (
        "disputed: 5 of the last 64 frames came out of sequence; a second sender under its identifier? stop one of them"
    )


def test_a_frame_that_is_doubled_is_no_error_even_after_another_with_its_counter() -> None:
    sender, _ = receive_all([(1, b"mine"), (1, b"other"), (1, b"mine")])
    assert sender.data == b"mine"
    assert sender.window == SequenceWindow(errors=1)  # the other one alone
