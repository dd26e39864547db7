from __future__ import annotations

from positioner.cycle.alarms import message_of, packed, worst_of
from positioner.health.causes import TEXTS, AlarmCause
from positioner.host.words import ALARMS, alarms_in_words
from positioner.wire.codec import packaged_dbc_text
from positioner.wire.messages import Health, PositionerAlarms


def test_the_packed_number_holds_worst_category_and_both_rows_of_bits() -> None:
    for worst in Health:
        number = packed(worst, 0xFFFF, 0x8001)
        assert worst_of(number) is worst
        assert message_of(number) == PositionerAlarms(worst, 15, 0xFFFF, 0x8001)
        assert number < 1 << 56
    assert packed(Health.GOOD, 0, 0) == 0


def test_host_and_dbc_name_every_cause_by_its_bit() -> None:
    assert len(ALARMS) == len(AlarmCause)
    for cause, name in zip(AlarmCause, ALARMS, strict=True):
        words = set(cause.key.replace("high", "risen").replace("low", "fallen").split("_")) - {"one", "sided"}
        assert words <= set(name.split()), (cause, name)
        assert f"{int(cause)} {name}" in packaged_dbc_text()
        assert cause in TEXTS


def test_the_host_says_which_alarms_are_new_and_which_are_over() -> None:
    assert alarms_in_words(None) == "none"
    assert alarms_in_words(PositionerAlarms(Health.GOOD, 0, 0, 0)) == "none"
    told = PositionerAlarms(Health.MAINTENANCE_REQUIRED, 2, 0b1001, 0b0110_0001)
    assert alarms_in_words(told) == (
        "friction risen (new), spring rate, one direction (over, not acknowledged), end position (over, not "
        "acknowledged) (NE 107: maintenance required; see `positioner health`)"
    )
