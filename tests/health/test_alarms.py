from __future__ import annotations

import pytest

from positioner.health.alarms import Alarm, Changed, Watched, acknowledged, bits, judged, worst
from positioner.health.causes import LIMITS, TEXTS, AlarmCause, Limits
from positioner.health.settings import AlarmSettings, Category, HealthTable
from positioner.wire.messages import Health

RISEN = AlarmCause.FRICTION_HIGH
SOON = {**LIMITS, RISEN: Limits(0.2, Health.MAINTENANCE_REQUIRED, 0.4, Health.OUT_OF_SPECIFICATION, 1.0)}


def play(*values: tuple[float, float], sigma: float = 0.0) -> tuple[tuple[Alarm, ...], list[Changed]]:
    """Return the alarms after the values, each at its instant, and all that happened."""
    alarms: tuple[Alarm, ...] = ()
    happened: list[Changed] = []
    for now_s, value in values:
        alarms, changed = judged(alarms, SOON, [Watched(RISEN, value, sigma, "200 moves")], now_s)
        happened += changed
    return alarms, happened


def test_an_alarm_comes_after_its_delay_with_cause_value_limit_and_evidence() -> None:
    assert play((0.0, 0.21), (0.9, 0.21))[1] == []
    (alarm,), (change,) = play((0.0, 0.21), (0.9, 0.21), (1.0, 0.22))
    assert change == Changed(alarm, came=True)
    assert (alarm.cause, alarm.category, alarm.since_s) == (RISEN, Health.MAINTENANCE_REQUIRED, 1.0)
    assert (alarm.value, alarm.limit, alarm.evidence) == (0.22, 0.2, "200 moves")
    assert not alarm.acknowledged


def test_the_delay_begins_anew_when_the_value_comes_back() -> None:
    assert play((0.0, 0.21), (0.5, 0.19), (0.6, 0.21), (1.2, 0.21))[1] == []


def test_an_alarm_ends_below_four_fifths_of_its_limit_and_is_remembered_until_acknowledged() -> None:
    alarms, happened = play((0.0, 0.21), (1.0, 0.21), (2.0, 0.17), (3.0, 0.159))
    assert [change.came for change in happened] == [True, False]
    assert [alarm.is_active for alarm in alarms] == [False]
    assert acknowledged(alarms, [RISEN]) == ()
    assert acknowledged(alarms, [AlarmCause.STUCK]) == alarms


def test_an_alarm_that_was_acknowledged_is_gone_when_it_ends() -> None:
    alarms, _ = play((0.0, 0.21), (1.0, 0.21))
    alarms = acknowledged(alarms, [RISEN])
    assert [alarm.acknowledged for alarm in alarms] == [True]
    assert judged(alarms, SOON, [Watched(RISEN, 0.1)], 9.0)[0] == ()


def test_the_serious_limit_raises_the_category_keeps_the_date_and_asks_again() -> None:
    alarms, _ = play((0.0, 0.21), (1.0, 0.21))
    alarms = acknowledged(alarms, [RISEN])
    for now_s in (5.0, 6.0):
        alarms, happened = judged(alarms, SOON, [Watched(RISEN, 0.41)], now_s)
    assert [change.came for change in happened] == [True]
    assert (alarms[0].category, alarms[0].since_s, alarms[0].limit) == (Health.OUT_OF_SPECIFICATION, 1.0, 0.4)
    assert not alarms[0].acknowledged
    alarms, happened = judged(alarms, SOON, [Watched(RISEN, 0.3)], 7.0)
    assert [change.came for change in happened] == [False]
    assert (alarms[0].category, alarms[0].is_active) == (Health.MAINTENANCE_REQUIRED, True)


def test_a_change_that_may_be_chance_is_no_alarm() -> None:
    assert play((0.0, 0.25), (2.0, 0.25), sigma=0.1)[1] == []
    (alarm,), _ = play((0.0, 0.25), (2.0, 0.25), sigma=0.05)
    assert 0.9 < alarm.sure < 0.99
    assert play((0.0, 0.25), (2.0, 0.25))[0][0].sure == 1.0


def test_a_value_that_wavers_about_the_limit_gives_one_alarm() -> None:
    values = [(0.1 * number, 0.2 + (0.02 if number % 20 < 15 else -0.02)) for number in range(400)]
    assert [change.came for change in play(*values)[1]] == [True]


def test_the_worst_category_and_the_bits_are_of_the_active_alarms() -> None:
    alarms, _ = play((0.0, 0.41), (1.0, 0.41))
    assert worst(alarms) is Health.OUT_OF_SPECIFICATION
    assert worst(()) is Health.GOOD
    assert bits([AlarmCause.FRICTION_HIGH, AlarmCause.STUCK]) == 0x1001


def test_every_cause_has_limits_a_text_and_a_table_in_the_configuration() -> None:
    settings = HealthTable()
    for cause in AlarmCause:
        assert settings.limits_of(cause) == LIMITS[cause]
        assert TEXTS[cause].remedy


def test_a_table_of_a_cause_changes_only_what_it_names() -> None:
    own = HealthTable(friction_high=AlarmSettings(limit=0.3, serious_category=Category.FAILURE))
    limits = own.limits_of(RISEN)
    assert (limits.limit, limits.serious_limit, limits.delay_s) == (0.3, 0.4, LIMITS[RISEN].delay_s)
    assert (limits.category, limits.serious_category) == (Health.MAINTENANCE_REQUIRED, Health.FAILURE)
    with pytest.raises(ValueError, match="friction_high: serious_limit must not be below limit"):
        HealthTable(friction_high=AlarmSettings(limit=0.5))


def test_a_cause_that_is_off_is_no_alarm() -> None:
    off = AlarmSettings(category=Category.OFF, serious_category=Category.OFF)
    limits = {RISEN: HealthTable(friction_high=off).limits_of(RISEN)}
    assert judged((), limits, [Watched(RISEN, 9.0)], 0.0) == ((), ())
