from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any

import pytest
from stem import GAIN, PERIOD_S, REFERENCE, SETTINGS, SPAN, Stem, pushes

from positioner.commissioning.stroke.memory import Cause as Stopped
from positioner.health.alarm_text import alarm_as_json, alarm_lines, change_in_words, trend_line, trends_as_json
from positioner.health.alarms import Changed, dated, packed_alarms
from positioner.health.causes import LIMITS, AlarmCause
from positioner.health.counters import Counters
from positioner.health.kept_tests import response_watched, stroke_test_watched
from positioner.health.observed import ObservedCycle
from positioner.health.pressure import Pressure, PressureSettings, acted_ma
from positioner.health.reference import Reference, reference_of
from positioner.health.settings import HealthTable
from positioner.health.trends_document import trends_from, trends_in
from positioner.health.watch import Trends, Watch, WatchSettings, changes_of, watch_cycle
from positioner.report.trend_table import trend_table
from positioner.valve.actuator import ActuatorParameters
from positioner.valve.parameters import ValveParameters
from positioner.wire.messages import Cause, Health, Mode

IMMEDIATE = PressureSettings.of(GAIN / 0.06452, ActuatorParameters(), PERIOD_S)
SETTINGS_OF = WatchSettings.of(SETTINGS, IMMEDIATE, REFERENCE, HealthTable(averaging=0.05))


def at(now_us: int, cycles: int = 0, travel_m: float = 0.0) -> Counters:
    return Counters(mode_us=(0, 0, now_us, 0, 0, 0), cycles=cycles, travel_m=travel_m)


def watched(
    stem: Stem, currents_ma: list[float], settings: WatchSettings = SETTINGS_OF, watch: Watch | None = None
) -> tuple[Watch, list[Changed]]:
    watch = watch or Watch()
    changed: list[Changed] = []
    for number, current_ma in enumerate(currents_ma):
        cycle = ObservedCycle(number * 1000, Mode.ACTIVE, Cause.NONE, stem.play(current_ma), None, current_ma, None, ())
        watch_cycle(settings, watch, cycle, at(number * 1000))
        changed += watch.changed
    return watch, changed


def causes(changed: list[Changed]) -> list[AlarmCause]:
    return [change.alarm.cause for change in changed if change.came]


def test_friction_that_has_risen_is_told_once_with_evidence_and_remedy() -> None:
    watch, changed = watched(Stem(friction=1.3), pushes(60))
    assert causes(changed) == [AlarmCause.FRICTION_HIGH]
    (alarm,) = dated(watch.trends.alarms, "2026-11-22T10:00:00Z")
    first, evidence, remedy = alarm_lines(alarm)
    assert first.startswith("maintenance required: friction has risen: 2")
    assert "limit 20, since 2026-11-22T10:00:00Z, not acknowledged" in first
    assert evidence.endswith("% sure")
    assert remedy.startswith("remedy: look at the packing: too tight")
    assert change_in_words(changed[0]).startswith("alarm: friction has risen: 2")
    assert json.loads(json.dumps(alarm_as_json(alarm)))["cause"] == "friction_high"
    assert packed_alarms(watch.trends.alarms) == 1 << 32 | 1 << 16 | 1


def test_friction_that_has_fallen_is_told() -> None:
    watch, changed = watched(Stem(friction=0.75), pushes(60))
    assert causes(changed) == [AlarmCause.FRICTION_LOW]
    assert alarm_lines(watch.trends.alarms[0])[0].startswith("maintenance required: friction has fallen: -2")


def test_without_a_measured_reference_no_trend_is_an_alarm() -> None:
    configured = replace(SETTINGS_OF, reference=replace(REFERENCE, source="configuration"))
    watch, changed = watched(Stem(friction=1.3), pushes(60), configured)
    assert changed == []
    assert trend_line(configured, watch.trends).startswith("against the configuration")


def test_a_supply_that_limits_one_direction_is_not_called_friction() -> None:
    _, changed = watched(Stem(supply_ma=15.5), pushes(80))
    assert AlarmCause.FRICTION_HIGH not in causes(changed)
    assert AlarmCause.FRICTION_LOW not in causes(changed)
    assert AlarmCause.ONE_SIDED in causes(changed)


def test_a_stem_that_does_not_move_under_more_than_its_friction_is_stuck() -> None:
    stuck = Stem(friction=3.0)
    _, changed = watched(stuck, [11.0] * 100 + [20.0] * 1500 + [11.0] * 100)
    assert changed == []
    watch, changed = watched(stuck, [11.0] * 100 + [20.0] * 3000)
    assert causes(changed) == [AlarmCause.STUCK]
    assert packed_alarms(watch.trends.alarms) >> 32 == 4
    _, changed = watched(stuck, [11.0] * 600, watch=watch)
    assert [change.came for change in changed] == [False]


def test_a_stem_that_stands_on_its_stop_is_not_stuck() -> None:
    stem = Stem(position_m=0.0005, friction=3.0)
    _, changed = watched(stem, [10.0] * 100 + [0.1] * 3000)
    assert changed == []


def test_trends_are_kept_and_begin_anew_against_another_reference() -> None:
    watch, _ = watched(Stem(friction=1.3), pushes(60))
    kept = json.loads(json.dumps(trends_in(replace(watch.trends, against=("identify", "2026-01-01")))))
    found = trends_from(kept, REFERENCE)
    assert found == replace(watch.trends, against=("identify", "2026-01-01"))
    anew = trends_from(kept, replace(REFERENCE, recorded="2026-02-02"))
    assert anew == Trends(("identify", "2026-02-02"), alarms=found.alarms)
    assert trends_from(None, REFERENCE) == Trends(("identify", "2026-01-01"))


def test_a_reference_of_which_only_the_day_was_kept_goes_on_and_one_of_another_instant_begins_anew() -> None:
    watch, _ = watched(Stem(friction=1.3), pushes(60))
    kept = json.loads(json.dumps(trends_in(replace(watch.trends, against=("identify", "2026-01-01")))))
    morning = replace(REFERENCE, recorded="2026-01-01T08:15:00Z")
    found = trends_from(kept, morning)
    assert found == replace(watch.trends, against=("identify", "2026-01-01T08:15:00Z"))
    kept = json.loads(json.dumps(trends_in(found)))
    assert trends_from(kept, morning).friction.moves == watch.trends.friction.moves > 0
    assert trends_from(kept, replace(REFERENCE, recorded="2026-01-01T16:15:00Z")).friction.moves == 0


@pytest.mark.parametrize(
    "change",
    [
        {"friction": {}},
        {"friction": None},
        {"ends": [0.0, -1, 0.0, 0]},
        {"alarms": [{}]},
        {"alarms": "none"},
        {"more": 1},
    ],
)
def test_trends_that_were_not_written_so_are_refused(change: dict[str, Any]) -> None:
    section = {**trends_in(Trends(("identify", "2026-01-01"))), **change}
    with pytest.raises(ValueError, match=r"not as|no list"):
        trends_from(section, REFERENCE)


def test_the_trends_are_told_in_words_and_for_programs() -> None:
    watch, _ = watched(Stem(friction=1.3), pushes(60))
    assert trend_line(SETTINGS_OF, watch.trends).startswith("against `identify` of 2026-01-01; 4")
    found = changes_of(SETTINGS_OF, watch.trends)
    first, *_ = trend_table(found, SETTINGS_OF.limits).rows
    assert (first[0], *first[3:]) == ("sliding friction", "±20 %", "±40 %")
    assert float(first[1].removesuffix(" %")) == pytest.approx(100.0 * found.friction.value, abs=0.05)
    assert json.loads(json.dumps(trends_as_json(SETTINGS_OF, watch.trends)))["reference"]["source"] == "identify"


VALVE = ValveParameters(id="FV-101")


def test_a_change_that_no_move_has_shown_is_none_and_not_zero() -> None:
    told = trends_as_json(SETTINGS_OF, Trends(("identify", "2026-01-01")))
    assert set(told["changes"].values()) == {None}
    assert told["ends"] == {name: {"value": None, "seen": 0} for name in ("closed", "open")}
    watch, _ = watched(Stem(friction=1.3), pushes(60))
    assert trends_as_json(SETTINGS_OF, watch.trends)["changes"]["sliding_friction"]["value"] == pytest.approx(
        0.3, abs=0.05
    )


def test_the_reference_is_the_signature_else_the_identification_else_the_configuration() -> None:
    identified = (
        "2026-01-01",
        {"configuration": {"valve": {"spring_rate_n_per_m": 5e4, "coulomb_friction_n": 1400.0}}},
    )
    signature = (
        "2026-02-02",
        {
            "quantities": {"spring_n_per_m": 5.1e4, "sliding_n": 1500.0, "static_n": 1800.0, "hysteresis_m": 0.05},
            "rows": [{"name": "spring force at 0", "value": 20.0}],
            "sliding_friction_by_place": [[0.07, 1600.0], [0.06, 1400.0]],
        },
    )
    found = reference_of(VALVE, identified, signature)
    assert (found.source, found.recorded, found.preload_n) == ("signature", "2026-02-02", 20.0)
    assert found.sliding_along_n(0.059, 0.071) == 1500.0
    found = reference_of(VALVE, identified)
    assert (found.source, found.spring_n_per_m, found.sliding_n) == ("identify", 5e4, 1400.0)
    assert found.static_n == VALVE.static_friction_n
    assert reference_of(VALVE) == Reference.configured(VALVE)
    with pytest.raises(ValueError, match="not above 0"):
        reference_of(VALVE, ("2026-01-01", {"configuration": {"valve": {"coulomb_friction_n": -1.0}}}))


def test_an_end_position_that_has_moved_is_told() -> None:
    watch = Watch()
    changed: list[Changed] = []
    for number in range(400):
        on_seat = number % 100 < 60
        position_m = 0.015 * SPAN if on_seat else 0.015 * SPAN + 0.01
        current_ma = -8.0 if number % 100 < 50 else 9.0
        cycle = ObservedCycle(number * 1000, Mode.ACTIVE, Cause.NONE, position_m, None, current_ma, None, ())
        watch_cycle(SETTINGS_OF, watch, cycle, at(number * 1_000_000))
        changed += watch.changed
    assert causes(changed) == [AlarmCause.END_POSITION]
    assert watch.trends.closed == pytest.approx(0.015, abs=1e-6)


def test_counts_and_the_results_of_tests_are_told() -> None:
    response = response_watched("2026-11-22", step_test(0.05), step_test(0.03))
    stroke_test = stroke_test_watched("2026-11-22", {"stop": None, "findings": [], "verdict": "passed"})
    settings = replace(SETTINGS_OF, response=response, stroke_test=stroke_test, stroke_test_due_s=1.0)
    watch = Watch()
    told: list[tuple[int, AlarmCause, str]] = []
    for second, cycles, travel_m in ((0, 0, 0.0), (1, 899_999, 1.0), (2, 900_000, 1.0), (3, 900_000, 0.9e6 * SPAN)):
        cycle = ObservedCycle(second * 1_000_000, Mode.ACTIVE, Cause.NONE, 0.07, None, 11.0, None, ())
        watch_cycle(settings, watch, cycle, at(second * 1_000_000, cycles, travel_m))
        told += [(second, change.alarm.cause, change.alarm.evidence) for change in watch.changed]
    assert told == [
        (1, AlarmCause.RESPONSE_TIME, "T86 of steps of 1 % up, in the test of 2026-11-22"),
        (2, AlarmCause.CYCLES, "900000 cycles"),
        (2, AlarmCause.STROKE_TEST, "overdue"),
        (3, AlarmCause.TRAVEL, "114300.0 m"),
    ]


def step_test(t86_s: float) -> dict[str, Any]:
    same = {"size": 2.0, "direction": "down", "t86_s": {"median": 0.04}}
    return {"sizes": [{"size": 1.0, "direction": "up", "t86_s": {"median": t86_s}}, same]}


def test_a_stroke_test_says_passed_failed_or_stuck() -> None:
    passed: dict[str, Any] = {"stop": None, "findings": [], "verdict": "passed"}
    failed = {"stop": None, "findings": [{"limit": "air too slow", "text": ""}], "verdict": "failed"}
    stuck, still = (
        {"stop": {"cause": str(cause)}, "findings": [], "verdict": "failed"}
        for cause in (Stopped.STUCK, Stopped.NO_MOTION)
    )
    stopped = {"stop": {"cause": "new setpoint"}, "findings": [], "verdict": "aborted"}
    found = [stroke_test_watched("2026-11-22", each).value for each in (passed, failed, stuck, still, stopped)]
    assert found == [0.0, 1.0, 2.0, 2.0, 0.0]
    assert LIMITS[AlarmCause.STROKE_TEST].serious_category is Health.FAILURE
    assert response_watched("2026-11-22", step_test(0.03), {"sizes": []}) is None


def test_with_a_lag_the_work_is_that_of_the_pressure() -> None:
    # p = 5 + 5·(1 - e^(-t/τ)) after a step of the current, and its mean over each period
    lag = PressureSettings.of(1.0, ActuatorParameters(fill_time_constant_s=0.1, vent_time_constant_s=0.1), 0.001)
    state = Pressure()
    acted_ma(lag, state, 5.0, None, 1)
    for number in range(300):
        exact = 10.0 - 5.0 * 0.1 / 0.001 * (math.exp(-number * 0.01) - math.exp(-(number + 1) * 0.01))
        assert acted_ma(lag, state, 10.0, None, 1) == pytest.approx(exact, abs=1e-3)
    assert acted_ma(IMMEDIATE, Pressure(), 10.0, None, 1) == 10.0


def test_a_measured_pressure_counts_in_place_of_the_current() -> None:
    state = Pressure()
    gain = IMMEDIATE.gain_pa_per_ma
    assert acted_ma(IMMEDIATE, state, 10.0, 4.0 * gain, 1) == pytest.approx(4.0)
    assert acted_ma(IMMEDIATE, state, 10.0, 6.0 * gain, 1) == pytest.approx(5.0)


def test_cycles_of_large_spans_spend_the_packing_sooner_than_their_number_says() -> None:
    wear = HealthTable(allowed_cycles=((0.1, 1e6), (1.0, 1e3))).wear
    settings, watch = replace(SETTINGS_OF, wear=wear), Watch()
    cycle = ObservedCycle(0, Mode.ACTIVE, Cause.NONE, 0.05, None, 11.0, None, ())
    spans = (0,) * 20 + (950,)
    watch_cycle(settings, watch, replace(cycle, now_us=0), replace(at(0), cycles=950, spans=spans))
    watch_cycle(settings, watch, replace(cycle, now_us=600_000), replace(at(600_000), cycles=950, spans=spans))
    (alarm,) = watch.trends.alarms
    assert (alarm.cause, alarm.evidence) == (AlarmCause.CYCLES, "950 cycles, by their spans")
    assert alarm.value == pytest.approx(0.95)
