"""End-to-end protection: the CRC against AUTOSAR's example and a second implementation, and the counters."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from e2e import p05
from hypothesis import given
from hypothesis import strategies as st

from positioner.wire import e2e
from positioner.wire.e2e import CounterCheck, Sequence

FRESH, REPEATED, LATE, OUT_OF_ORDER = Sequence.FRESH, Sequence.REPEATED, Sequence.LATE, Sequence.OUT_OF_ORDER


def test_the_example_that_autosar_publishes_for_profile_5() -> None:
    assert e2e.protect(bytes(8), 0x1234) == bytes.fromhex("1c ca 00 00 00 00 00 00")


@given(payload=st.binary(min_size=8, max_size=8), data_id=st.integers(0, 0xFFFF))
def test_protection_equals_an_independent_implementation(payload: bytes, data_id: int) -> None:
    theirs = bytearray(payload)
    p05.e2e_p05_protect(theirs, data_id, increment_counter=False)
    assert e2e.protect(payload, data_id) == bytes(theirs)
    assert e2e.is_intact(bytes(theirs), data_id)
    assert e2e.is_intact(payload, data_id) is p05.e2e_p05_check(payload, data_id)


def test_up_to_three_flipped_bits_never_pass() -> None:
    data = e2e.protect(bytes(range(8)), 0x1F10)
    word = int.from_bytes(data, "big")
    for count in (1, 2, 3):
        for bits in itertools.combinations(range(64), count):
            damaged = word ^ sum(1 << bit for bit in bits)
            assert not e2e.is_intact(damaged.to_bytes(8, "big"), 0x1F10)


def test_every_burst_of_15_bits_is_detected_and_all_but_six_of_16() -> None:
    """Bits in the order of transmission. The six straddle the CRC field and the counter: the CRC stands first."""
    undetected = {length: sum(_undetected(start, length) for start in range(65 - length)) for length in range(1, 17)}
    assert undetected == {**dict.fromkeys(range(1, 16), 0), 16: 6}
    assert sum(_undetected(start, 16) for start in range(16, 49)) == 0


def _undetected(start: int, length: int) -> int:
    """Return the number of bursts from bit `start`, first and last bit wrong, that the linear CRC does not detect."""
    sums = np.array([_syndrome(start)], dtype=np.uint16)
    if length > 1:
        sums ^= np.uint16(_syndrome(start + length - 1))
    for bit in range(start + 1, start + length - 1):
        sums = np.concatenate([sums, sums ^ np.uint16(_syndrome(bit))])
    return int(np.count_nonzero(sums == 0))


def _syndrome(bit: int) -> int:
    """Return the difference between the sent CRC and the computed one that one flipped bit causes."""
    flipped = (1 << (63 - bit)).to_bytes(8, "big")
    return int.from_bytes(flipped[:2], "little") ^ e2e.crc(flipped[2:], 0) ^ e2e.crc(bytes(6), 0)


def test_too_few_bytes_are_not_intact() -> None:
    assert not any(e2e.is_intact(bytes(length), data_id) for length in (0, 1) for data_id in range(0x10000))


def test_no_other_data_id_passes() -> None:
    data = e2e.protect(bytes(range(8)), 0x1F10)
    assert [data_id for data_id in range(0x10000) if e2e.is_intact(data, data_id)] == [0x1F10]


def verdicts(counters: list[int], modulus: int = 256) -> list[tuple[Sequence, int]]:
    check, seen = CounterCheck(modulus=modulus), []
    for counter in counters:
        check, verdict, lost = check.check(counter)
        seen.append((verdict, lost))
    return seen


def test_counting_on_is_fresh_and_so_is_the_wrap() -> None:
    assert verdicts([253, 254, 255, 0, 1]) == [(FRESH, 0)] * 5


@pytest.mark.parametrize("start", [0, 17, 255])
def test_any_first_counter_is_fresh(start: int) -> None:
    assert verdicts([start]) == [(FRESH, 0)]


def test_a_repeated_counter_is_reported_and_does_not_disturb_the_count() -> None:
    assert verdicts([7, 7, 7, 8]) == [(FRESH, 0), (REPEATED, 0), (REPEATED, 0), (FRESH, 0)]


@pytest.mark.parametrize("lost", range(1, 11))
def test_up_to_ten_lost_frames_are_counted_also_across_the_wrap(lost: int) -> None:
    assert verdicts([250, (251 + lost) % 256]) == [(FRESH, 0), (FRESH, lost)]


def test_eleven_lost_frames_need_a_second_frame_to_be_believed() -> None:
    assert verdicts([0, 12, 13, 14]) == [(FRESH, 0), (OUT_OF_ORDER, 0), (FRESH, 0), (FRESH, 0)]


@pytest.mark.parametrize("age", [1, 2, 11, 100, 244])
def test_a_replayed_old_frame_is_out_of_order_and_the_sender_goes_on(age: int) -> None:
    assert verdicts([99, 100, (100 - age) % 256, 101]) == [(FRESH, 0), (FRESH, 0), (OUT_OF_ORDER, 0), (FRESH, 0)]


def test_two_frames_that_overtook_each_other_make_one_late() -> None:
    assert verdicts([10, 12, 11, 13]) == [(FRESH, 0), (FRESH, 1), (LATE, 0), (FRESH, 0)]


def test_late_frames_are_no_restart_however_many_come() -> None:
    assert verdicts([10, 14, 11, 12, 13, 15])[2:] == [(LATE, 0), (LATE, 0), (LATE, 0), (FRESH, 0)]
    assert verdicts([254, 2, 255, 1, 0, 3])[2:] == [(LATE, 0), (LATE, 0), (LATE, 0), (FRESH, 0)]


@pytest.mark.parametrize(
    "counters",
    [
        [10, 12, 11, 11],  # came already
        [10, 15, 11],  # four counts late
        [10, 11, 10],  # was never missing
        [10, 12, 12, 13, 14, 10],
        [10, 12, 100, 101, 11],  # of before a restart
    ],
)
def test_an_old_frame_that_was_not_missing_a_moment_ago_is_out_of_order(counters: list[int]) -> None:
    assert verdicts(counters)[-1] == (OUT_OF_ORDER, 0)


def test_a_repetition_in_between_does_not_make_a_late_frame_forgotten() -> None:
    assert verdicts([10, 12, 12, 13, 11])[-1] == (LATE, 0)


def test_a_late_frame_in_between_makes_a_restart_start_over() -> None:
    assert verdicts([198, 200, 0, 199, 1])[-1] == (OUT_OF_ORDER, 0)


def test_a_restarted_sender_is_taken_over_with_its_second_frame() -> None:
    assert verdicts([200, 0, 1, 2]) == [(FRESH, 0), (OUT_OF_ORDER, 0), (FRESH, 0), (FRESH, 0)]
    assert verdicts([200, 0, 1, 100]) == [(FRESH, 0), (OUT_OF_ORDER, 0), (FRESH, 0), (OUT_OF_ORDER, 0)]


@pytest.mark.parametrize("second", [100, 102, 90])
def test_two_old_frames_that_do_not_follow_each_other_are_no_restart(second: int) -> None:
    assert verdicts([200, 100, second]) == [(FRESH, 0), (OUT_OF_ORDER, 0), (OUT_OF_ORDER, 0)]


@pytest.mark.parametrize("between", [200, 201])
def test_a_frame_of_the_first_sender_in_between_makes_the_restart_start_over(between: int) -> None:
    assert verdicts([200, 0, between, 1])[-1] == (OUT_OF_ORDER, 0)


def test_two_interleaved_senders_never_both_pass() -> None:
    seen = verdicts([50, 150, 51, 151, 52, 152, 53])
    assert seen == [(FRESH, 0), (OUT_OF_ORDER, 0)] * 3 + [(FRESH, 0)]


def test_a_counter_of_four_bits_wraps_loses_and_restarts() -> None:
    assert verdicts([14, 15, 0, 1], modulus=16) == [(FRESH, 0)] * 4
    assert verdicts([14, 9], modulus=16) == [(FRESH, 0), (FRESH, 10)]
    assert verdicts([14, 10, 11], modulus=16) == [(FRESH, 0), (OUT_OF_ORDER, 0), (FRESH, 0)]
    assert verdicts([2, 15, 0], modulus=16) == [(FRESH, 0), (OUT_OF_ORDER, 0), (FRESH, 0)]
    assert verdicts([14, 14], modulus=16) == [(FRESH, 0), (REPEATED, 0)]


@given(start=st.integers(0, 255), steps=st.lists(st.integers(1, 11), max_size=300))
def test_whatever_a_sender_loses_in_runs_of_ten_the_count_of_lost_frames_is_right(start: int, steps: list[int]) -> None:
    counters = [(start + total) % 256 for total in itertools.accumulate(steps, initial=0)]
    seen = verdicts(counters)
    assert [verdict for verdict, _ in seen] == [FRESH] * len(seen)
    assert [lost for _, lost in seen] == [0, *(step - 1 for step in steps)]


def after(*counters: int) -> CounterCheck:
    check = CounterCheck()
    for counter in counters:
        check = check.check(counter)[0]
    return check


def test_only_frames_that_were_lost_can_come_late() -> None:
    assert after(0, 1, 3, 5).missing == 0b101  # 4 and 2, the newest first
    assert after(0, 1, 3, 6).missing == 0b11  # 5 and 4; 2 is too old
    assert after(5, 7).check(6)[1] is LATE
    assert after(5, 7).check(4)[1] is OUT_OF_ORDER


def test_a_frame_out_of_order_between_does_not_make_a_late_one_unknown() -> None:
    assert after(5, 7, 200) == CounterCheck(last=7, candidate=200, missing=0b1)
    assert after(5, 7, 200).check(6)[1] is LATE
