"""The verbs of the host: numbers, units, and mistakes, refused in one line before anything is sent."""

from __future__ import annotations

import pytest

from positioner.errors import UsageError
from positioner.guard.settings import GuardSettings
from positioner.host.verbs import HELP, Verb, Word, read_verbs
from positioner.host.words import CAUSES
from positioner.valve.parameters import ValveParameters
from positioner.wire.messages import Cause

VALVE = ValveParameters(id="paper")
KNOWN = "known: arm, disarm, set, profile, manual, auto, status, help, quit"
GUARD = GuardSettings(current_low_ma=4.0, current_high_ma=18.0)


def read(text: str, valve: ValveParameters = VALVE) -> tuple[Verb, ...]:
    return read_verbs(text.split(" "), valve, GUARD)


@pytest.mark.parametrize(
    ("text", "setpoint_m"),
    [
        ("set 80", 0.08),
        ("set 80mm", 0.08),
        ("set 80 mm", 0.08),
        ("SET 80.5MM", 0.0805),
        ("set 62%", 0.62 * 0.127),
        ("set 62 %", 0.62 * 0.127),
        ("set 6.2e1%", 0.62 * 0.127),
    ],
)
def test_a_setpoint_is_in_mm_or_in_percent_of_the_span(text: str, setpoint_m: float) -> None:
    (verb,) = read(text)
    assert verb.word is Word.SET
    assert verb.setpoint_m == pytest.approx(setpoint_m, rel=1e-12)


@pytest.mark.parametrize(
    ("text", "current_ma"), [("manual 9.5mA", 9.5), ("manual 9.5", 9.5), ("manual 9.5 mA", 9.5), ("manual", None)]
)
def test_a_current_is_in_ma_and_without_a_number_the_present_one_stays(text: str, current_ma: float | None) -> None:
    assert read(text) == (Verb(Word.MANUAL, current_ma=current_ma),)


def test_verbs_stand_one_after_another() -> None:
    words = [verb.word for verb in read("arm set 62% manual auto status manual 9.5mA disarm")]
    assert words == [Word.ARM, Word.SET, Word.MANUAL, Word.AUTO, Word.STATUS, Word.MANUAL, Word.DISARM]
    assert read("") == ()


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("amr", f"'amr' is no verb of the host; did you mean 'arm'? {KNOWN}"),
        ("80", f"'80' is no verb of the host; {KNOWN}"),
        ("frobnicate", f"'frobnicate' is no verb of the host; {KNOWN}"),
        ("set", "set needs a position: `set 80` (mm) or `set 62%` (of the span)"),
        ("set arm", "set needs a position: `set 80` (mm) or `set 62%` (of the span)"),
        ("set 80cm", "set 80cm: is no number in mm or %; write it like `set 9.5%`"),
        ("set 62,5%", "set 62,5%: is no number in mm or %; write it like `set 9.5%`"),
        ("set 9.5mA", "set 9.5ma: is no number in mm or %; write it like `set 9.5%`"),
        ("set 140", "set 140: 140 mm is outside the travel of 0 to 139.7 mm"),
        ("set -1%", "set -1%: -1.27 mm is outside the travel of 0 to 139.7 mm"),
        ("set 1e999", "set 1e999: inf mm is outside the travel of 0 to 139.7 mm"),
        ("set 30", "set 30: 30 mm is out of reach: with 4 to 18 mA the stem gets to 52.5 to 87.2 mm"),
        ("set 88", "set 88: 88 mm is out of reach: with 4 to 18 mA the stem gets to 52.5 to 87.2 mm"),
        ("manual 62%", "manual 62%: is no number in mA; write it like `manual 9.5mA`"),
        ("manual 3.9", "manual 3.9: 3.9 mA is beyond the limits of 4 to 18 mA (guard.current_*)"),
        ("manual 18.1mA", "manual 18.1ma: 18.1 mA is beyond the limits of 4 to 18 mA (guard.current_*)"),
    ],
)
def test_a_mistake_is_refused_in_one_line(text: str, line: str) -> None:
    with pytest.raises(UsageError) as caught:
        read(text)
    assert str(caught.value) == line


def test_the_reach_ends_at_the_stops_and_may_be_nothing() -> None:
    assert VALVE.reach_m(4.0, 40.0) == pytest.approx(((4.0 * 333.637 + 1423.0) / 52538.0, 0.1397), rel=1e-4)
    assert VALVE.reach_m(0.0, 20.0)[0] == pytest.approx(1423.0 / 52538.0, rel=1e-9)
    stiff = ValveParameters(id="stiff", coulomb_friction_n=1e4, static_friction_n=1e4)
    with pytest.raises(UsageError, match="gets to nothing"):
        read("set 80", stiff)


def test_the_help_names_every_verb_and_both_units_of_a_bare_number() -> None:
    for word in set(Word) - {Word.HELP, Word.QUIT}:
        assert f"\n{word}" in f"\n{HELP}"
    assert "set 80 " in HELP
    assert "`set 80mm` is the same" in HELP


def test_every_cause_has_its_words() -> None:
    assert set(CAUSES) == set(Cause)
    assert len(set(CAUSES.values())) == len(CAUSES)
