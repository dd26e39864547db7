"""The quick part of the fuzz, and proof that it would find what it looks for; `make fuzz` is the long part."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from endurance.attacks import ATTACKS, DAMAGING, TRUE, UNRECEIVED
from endurance.fuzz import DisagreementError, fuzz
from endurance.oracle import KINDS, Ledger
from positioner.wire import e2e
from positioner.wire.codec import own_database
from positioner.wire.e2e import CounterCheck, Sequence

QUICK = 12_000
WORDS = {
    Sequence.FRESH: "good",
    Sequence.REPEATED: "repeated counter",
    Sequence.LATE: "counter out of order",
    Sequence.OUT_OF_ORDER: "counter out of order",
}


def test_thousands_of_hostile_frames_and_none_is_accepted_that_should_not_be() -> None:
    found = fuzz(QUICK, seed=7)
    assert found.frames == QUICK
    received = set(ATTACKS) - UNRECEIVED
    assert set(found.attacks) == received | {TRUE}
    assert min(found.attacks[attack] for attack in received) > QUICK / 40
    # a CRC of 16 bits lets one in 65536 through; so few frames, hardly one
    assert found.accidents <= 3
    assert sum(found.verdicts.values()) == QUICK
    assert found.verdicts["good"] > QUICK / 10
    assert received >= DAMAGING


def test_the_same_seed_gives_the_same_run_and_another_does_not() -> None:
    one, same, other = fuzz(500, seed=1), fuzz(500, seed=1), fuzz(500, seed=2)
    assert one == same
    assert one.attacks != other.attacks


def disagreement() -> str:
    with pytest.raises(DisagreementError) as caught:
        fuzz(QUICK, seed=7)
    return str(caught.value)


def test_a_receiver_that_checks_no_crc_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(e2e, "is_intact", lambda _data, _data_id: True)
    message = disagreement()
    assert message.startswith("seed 7, frame ")
    assert "the oracle 'wrong CRC'" in message


@pytest.mark.parametrize("verdict", [Sequence.REPEATED, Sequence.OUT_OF_ORDER])
def test_a_receiver_that_takes_old_frames_is_found(monkeypatch: pytest.MonkeyPatch, verdict: Sequence) -> None:
    honest = CounterCheck.check

    def lenient(self: CounterCheck, counter: int) -> tuple[CounterCheck, Sequence, int]:
        check, verdict_now, lost = honest(self, counter)
        return check, Sequence.FRESH if verdict_now is verdict else verdict_now, lost

    monkeypatch.setattr(CounterCheck, "check", lenient)
    assert f"the oracle '{WORDS[verdict]}'" in disagreement()


def test_a_receiver_that_refuses_good_frames_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(e2e, "MAX_LOST_FRAMES", 9)
    message = disagreement()
    refused = "the positioner says 'counter out of order', the oracle 'good'"
    assert refused in message or "the valve did not obey a good command" in message


def test_the_oracle_knows_every_frame_of_the_dbc() -> None:
    messages = {message.frame_id: message for message in own_database().messages}
    assert {frame_id: message.name for frame_id, message in messages.items()} == {
        frame_id: kind.name for frame_id, kind in KINDS.items()
    }
    for frame_id, kind in KINDS.items():
        layout = {(signal.start, signal.length) for signal in messages[frame_id].signals}
        assert {(signal.start, signal.length) for signal in (*kind.ranges, *kind.choices)} <= layout
        named = {signal.start: set(map(int, signal.choices)) for signal in messages[frame_id].signals if signal.choices}
        known = {
            signal.start: {raw for raw in range(signal.low, signal.high + 1) if signal.may_be(raw)}
            for signal in kind.choices
        }
        assert known == named


@given(st.lists(st.integers(0, 255), max_size=60))
def test_the_oracle_and_the_receiver_agree_on_any_sequence_of_counters(counters: list[int]) -> None:
    ledger, check = Ledger(), CounterCheck()
    for counter in counters:
        expected = ledger.enter(0, bytes([0, 0, counter]))
        check, verdict, _ = check.check(counter)
        assert WORDS[verdict] == expected


def test_the_oracle_and_the_receiver_agree_on_every_pair_of_steps() -> None:
    """Every pair of counter steps: losses, wraps, restarts, replays."""
    for first, second in itertools.product(range(256), range(256)):
        ledger, check = Ledger(), CounterCheck()
        for counter in (250, (250 + first) % 256, (250 + first + second) % 256):
            expected = ledger.enter(0, bytes([0, 0, counter]))
            check, verdict, _ = check.check(counter)
            assert WORDS[verdict] == expected, (first, second)
