"""Alarms, verdicts and trends of a report: the worst counts, the reference is the zero, damage spoils none."""

from __future__ import annotations

from dataclasses import replace
from datetime import timedelta
from typing import TYPE_CHECKING

import pytest
import report_samples as samples

from positioner.health.alarms import Alarm
from positioner.health.causes import AlarmCause
from positioner.health.watch import changes_of
from positioner.report.counter_sections import histogram_section
from positioner.report.layers import Limit, Line, Marks, Whiskers
from positioner.report.page import Status
from positioner.report.trend_sections import alarm_section, friction_chart, trend_section, verdict_of_alarm
from positioner.report.valve_verdict import verdict_of_valve
from positioner.wire.messages import Health

if TYPE_CHECKING:
    from positioner.commissioning.results import KeptResult
    from positioner.report.trend_sections import Service

OPTIONS = "--config fv101.toml"
PASSED = samples.result("stroke-test", samples.stroke_test())
STUCK = samples.result("stroke-test", samples.stroke_test("failed", "stuck", "no motion"))
HIGH = samples.friction_alarm(0.27)
ALARMED = samples.service(0.27, (HIGH,))


def test_the_worst_status_is_the_verdict_and_the_others_are_counted() -> None:
    service = samples.service(0.27, (HIGH, *samples.other_alarms()))
    verdict = verdict_of_valve({"stroke-test": (STUCK, PASSED)}, service, "", OPTIONS)
    assert verdict.status is Status.FAILURE
    assert verdict.sentence == "The stroke test failed: no motion. 2 more alarms below."
    verdict = verdict_of_valve({"stroke-test": (PASSED, PASSED)}, service, "", OPTIONS)
    assert verdict.status is Status.MAINTENANCE_REQUIRED
    assert verdict.sentence.endswith("1 more alarm below.")


@pytest.mark.parametrize(
    ("results", "service", "running", "status"),
    [
        ({}, None, "", Status.UNKNOWN),
        ({"signature": (samples.result("signature", samples.SIGNATURE),) * 2}, None, "", Status.UNKNOWN),
        ({}, samples.service(0.02), "", Status.GOOD),
        ({"stroke-test": (PASSED, PASSED)}, None, "", Status.GOOD),
        (
            {"stroke-test": (PASSED, PASSED)},
            samples.service(0.27, (HIGH,)),
            "positioner signature",
            Status.FUNCTION_CHECK,
        ),
        ({"stroke-test": (STUCK, PASSED)}, None, "positioner signature", Status.FAILURE),
    ],
)
def test_a_status_is_only_said_of_what_was_judged(
    results: dict[str, tuple[KeptResult, KeptResult]], service: Service | None, running: str, status: Status
) -> None:
    assert verdict_of_valve(results, service, running, OPTIONS).status is status


def test_a_good_valve_is_told_with_what_has_judged_it() -> None:
    verdict = verdict_of_valve({"stroke-test": (PASSED, PASSED)}, samples.service(-0.021), "", OPTIONS)
    expected = "No alarm is active; friction in service is −2 % against the reference. The stroke test was passed."
    assert (verdict.status, verdict.sentence, verdict.action) == (Status.GOOD, expected, "Nothing.")


@pytest.mark.parametrize(("change", "told"), [(-0.004, "0 %"), (0.004, "0 %"), (-0.021, "−2 %"), (0.021, "+2 %")])
def test_a_change_that_is_rounded_to_nothing_has_no_sign(change: float, told: str) -> None:
    verdict = verdict_of_valve({}, samples.service(change), "", OPTIONS)
    assert f"friction in service is {told} against" in verdict.sentence


def test_a_failed_stroke_test_is_one_alarm_and_not_two() -> None:
    alarm = Alarm(AlarmCause.STROKE_TEST, 1, Health.MAINTENANCE_REQUIRED, 0.0, 1.0, 0.0, 1.0, "failed on 9 Mar 2026")
    verdict = verdict_of_valve({"stroke-test": (STUCK, PASSED)}, samples.service(0.0, (alarm,)), "", OPTIONS)
    assert verdict.sentence == "The stroke test: failed on 9 Mar 2026."


def test_an_alarm_says_since_when_how_much_and_what_to_do() -> None:
    verdict = verdict_of_alarm(HIGH)
    assert verdict.status is Status.MAINTENANCE_REQUIRED
    expected = (
        "Friction has risen since 30 Aug 2026, 04:12 UTC: 27.0 %, the limit is 20.0 %; sliding friction in 300 moves"
    )
    assert verdict.sentence.replace("\N{NO-BREAK SPACE}", " ").startswith(expected)
    assert verdict.action.endswith("then positioner signature.")
    section = alarm_section((HIGH, *samples.other_alarms()))
    assert [row[1] for row in section.tables[0].rows] == ["Maintenance required", "Maintenance required", "has ended"]
    assert "none waits" in alarm_section(()).remarks[0]


def test_the_trend_is_drawn_against_the_reference_with_its_limits_and_intervals() -> None:
    section = trend_section(samples.service(0.27), samples.signatures(1.27))
    layers = section.charts[0].layers
    assert sorted(each.y for each in layers if isinstance(each, Limit)) == [-40.0, -20.0, 20.0, 40.0]
    (line,) = (each for each in layers if isinstance(each, Line))
    assert line.y == pytest.approx([0.0, 8.1, 27.0])
    assert line.x == pytest.approx([0.0, 0.45 * 195.69, 195.69], abs=0.01)
    first = next(each for each in layers if isinstance(each, Whiskers))
    assert (first.low[0], first.high[0]) == pytest.approx((-100.0 * 7.0 / 1423.0, 100.0 * 7.0 / 1423.0))
    in_service = [each for each in layers if isinstance(each, Marks)][-1]
    assert in_service.y == pytest.approx([27.0], abs=0.1)
    assert section.tables[0].rows[0][:2] == ("sliding friction", "+27.0 %")


@pytest.mark.parametrize(("change", "is_told"), [(0.001, False), (0.09, False), (0.11, True)])
def test_one_direction_is_told_to_have_changed_only_by_as_much_as_its_alarm_asks_for(
    change: float, is_told: bool
) -> None:
    """The spring's force has changed by 2 % of its range, as much as the noise of some moves; the limit is 20 %."""
    service = samples.service(change)
    trend = replace(service.trends.friction, right=(400.0, 0.0, 2e4 * change))
    service = replace(service, trends=replace(service.trends, friction=trend))
    assert changes_of(service.watch, service.trends).one_sided
    remarks = trend_section(service, ()).remarks
    assert any(line.startswith("One direction alone has changed") for line in remarks) is is_told


def test_a_histogram_without_a_sample_is_told_and_not_drawn() -> None:
    counters = replace(samples.counters(), deviation=(0,) * 15)
    section = histogram_section(counters, "")
    assert [chart.title for chart in section.charts] == ["Travel", "Cycle spans"]
    assert section.remarks == ("Deviation: no sample yet.",)
    assert histogram_section(samples.counters(), "").remarks == ()


@pytest.mark.parametrize(
    ("apart", "unit", "last"),
    [
        (timedelta(seconds=90), "seconds", 90.0),
        (timedelta(minutes=7), "minutes", 7.0),
        (timedelta(hours=47), "hours", 47.0),
        (timedelta(days=48.0), "days", 48.0),
        (timedelta(days=4 * 365.25), "years", 4.0),
    ],
)
def test_the_axis_of_the_trend_fits_the_age(apart: timedelta, unit: str, last: float) -> None:
    signatures = [
        samples.result("signature", samples.signature(), name, samples.MOMENT + part * apart)
        for name, part in (("a", 0.0), ("b", 1.0))
    ]
    service = samples.service(0.0)
    chart = friction_chart(signatures, 1423.0, None, service.watch.limits)
    assert chart is not None
    assert chart.x_label == f"{unit} since the first signature"
    (line,) = (each for each in chart.layers if isinstance(each, Line))
    assert line.x == pytest.approx([0.0, last])


def test_a_signature_without_an_interval_has_no_whisker() -> None:
    document = samples.signature() | {"rows": []}
    signatures = [
        samples.result("signature", document, name, moment)
        for name, moment in (("a", samples.MOMENT), ("b", samples.LATER))
    ]
    chart = friction_chart(signatures, 1423.0, None, samples.service(0.0).watch.limits)
    assert chart is not None
    assert "whisker" not in chart.svg()


def test_the_reference_is_told_with_its_time() -> None:
    assert trend_section(samples.service(0.0), ()).since == "against the signature of 9 Mar 2026, 14:05 UTC"


def test_a_damaged_signature_is_no_point_of_the_trend() -> None:
    damaged = samples.result("signature", {"valve": "FV-101", "quantities": []}, "c")
    section = trend_section(samples.service(0.27), (*samples.signatures(1.27), damaged))
    (line,) = (each for each in section.charts[0].layers if isinstance(each, Line))
    assert len(line.x) == 3
