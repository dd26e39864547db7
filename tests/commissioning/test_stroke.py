"""The partial stroke test of emulated valves: the plant's parameters are the truth."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Any

import pytest
from daemon_helpers import write_configuration
from slow_cases import slow
from stroke_runs import Played, configured, play

from plant_emulator.presets import plant_settings
from positioner.bus.address import BusAddress
from positioner.cli.main import main
from positioner.cli.stroke_test import stroke_test_of
from positioner.commissioning.stroke.memory import Cause, Phase
from positioner.commissioning.stroke.report import NO_CREDIT, as_json, compared, remarks, rows, verdict_line
from positioner.commissioning.stroke.result import Limit, StrokeResult, Verdict
from positioner.errors import ConfigurationError, ExitCode
from positioner.laws.law import Observation
from positioner.report.quantities import quantity_table
from positioner.wire.messages import HostRequest, ManualCurrent, Setpoint

if TYPE_CHECKING:
    from pathlib import Path

    from positioner.wire.messages import Message

PERIOD_S = 0.01
START_M = 0.08
STATIC_N, SLIDING_N, SPRING_N_PER_M, GAIN_N_PER_MA = 1707.7, 1423.0, 52538.0, 333.637
LOW = {"noise_of_reading": 0.0, "noise_of_span": 0.0005}
HIGH = {"noise_of_reading": 0.02, "noise_of_span": 0.0}
JUMP_M = (STATIC_N - SLIDING_N) / SPRING_N_PER_M


def stroked(
    friction: float = 1.0, sensor: dict[str, float] | None = None, stroke: dict[str, Any] | None = None, **more: Any
) -> tuple[Played, StrokeResult]:
    """Return the test of the paper's valve, with its friction `friction` times as large."""
    valve = {
        "static_friction_n": friction * STATIC_N,
        "coulomb_friction_n": friction * SLIDING_N,
        "initial_position_m": START_M,
        **more.pop("valve", {}),
    }
    calls = {name: more.pop(name) for name in ("host", "hears", "after", "seed") if name in more}
    plant = plant_settings("paper", {"sensor": sensor or LOW, "valve": valve, **more})
    played = play(configured(stroke_test=stroke or {}), plant, **calls)
    assert played.result is not None
    return played, played.result


def off_m(played: Played) -> float:
    return abs(played.stem_m[-1] - START_M)


@pytest.mark.parametrize("sensor", [LOW, HIGH], ids=["0.05 % of span", "2 % of reading"])
def test_a_healthy_valve_passes_and_its_friction_jump_and_way_are_measured(sensor: dict[str, float]) -> None:
    played, found = stroked(sensor=sensor)
    exact = 1.0 if sensor is LOW else 8.0
    assert found.verdict is Verdict.PASSED
    assert found.cause == ""
    assert found.static_n == pytest.approx(STATIC_N, rel=0.004 * exact)
    assert found.jump_m == pytest.approx(JUMP_M, rel=1e-6)
    assert found.jumped_m == pytest.approx(JUMP_M, abs=1e-4 * exact)
    assert START_M - min(played.stem_m) == pytest.approx(0.0127, abs=1.5e-4 * exact)
    assert START_M - found.furthest_m == pytest.approx(START_M - min(played.stem_m), abs=1.5e-4 * exact)
    assert off_m(played) < 0.005 * 0.127
    assert found.lag_s == pytest.approx(612.9 / SPRING_N_PER_M, abs=0.02 * exact)


@pytest.mark.parametrize("friction", [1.3, 2.0])
def test_more_friction_is_told_one_period_after_the_limit_of_the_force(friction: float) -> None:
    played, found = stroked(friction)
    assert found.verdict is Verdict.FAILED
    assert found.cause == "stuck, breakaway too high"
    stop = found.stop
    assert stop is not None
    limit_ma = 1.3 * STATIC_N / GAIN_N_PER_MA
    rest_ma = SPRING_N_PER_M * found.start_m / GAIN_N_PER_MA
    assert limit_ma < rest_ma - stop.current_ma <= limit_ma + 1.0 * PERIOD_S
    assert stop.time_s == pytest.approx(2.0 + limit_ma / 1.0, abs=3.0 * PERIOD_S)  # 2 s of rest, then 1 mA/s
    assert off_m(played) < 0.005 * 0.127


def test_a_loose_packing_fails_and_its_force_is_measured() -> None:
    _, found = stroked(0.5)
    assert found.verdict is Verdict.FAILED
    assert [each.limit for each in found.findings] == [Limit.LOW]
    assert found.static_n == pytest.approx(0.5 * STATIC_N, rel=0.01)


@pytest.mark.parametrize("lag_s", [0.5, 1.0])
def test_slow_air_fails_and_is_not_called_friction(lag_s: float) -> None:
    played, found = stroked(actuator={"fill_time_constant_s": lag_s, "vent_time_constant_s": lag_s})
    assert found.verdict is Verdict.FAILED
    assert [each.limit for each in found.findings] == [Limit.SLOW]
    assert found.lag_s == pytest.approx(lag_s, rel=0.1)
    assert found.static_n == pytest.approx(STATIC_N, rel=0.02)
    assert START_M - min(played.stem_m) < 0.0127 + 0.05 * 0.127


def sticking(at_s: float) -> dict[str, Any]:
    """Return a schedule by which the stem sticks fast at an instant."""
    keys = ("valve.static_friction_n", "valve.coulomb_friction_n")
    return {"schedule": [{"at_s": at_s, "key": key, "value": 20e3} for key in keys]}


def slow_air(lag_s: float, *, pressure: bool) -> dict[str, Any]:
    """Return plant tables of a slow actuator, with or without a pressure sensor."""
    lags = {"fill_time_constant_s": lag_s, "vent_time_constant_s": lag_s}
    return {"actuator": lags, "sensor": {**LOW, "reports_pressure": pressure}}


@pytest.mark.parametrize(("pressure", "at"), [(False, 2), (True, 1)])
def test_air_that_is_too_slow_for_the_ramp_is_told_from_a_stem_that_sticks_by_a_measured_pressure_alone(
    pressure: bool, at: int
) -> None:
    valve = configured().valve
    for friction, lag_s, words in ((2.0, 0.01, "the stem sticks"), (1.0, 4.0, "the air is slow or missing")):
        _, found = stroked(friction, **slow_air(lag_s, pressure=pressure))
        assert found.verdict is Verdict.FAILED
        assert found.cause == "stuck, breakaway too high"
        assert words in found.suspects
        assert len(found.suspects) == at
    line = "FV-101: stroke test failed: stuck, breakaway too high: "
    both = "the stem sticks, or the air is slow or missing (no pressure is measured)"
    assert verdict_line(found, valve) == line + ("the air is slow or missing" if pressure else both)
    assert any(each.startswith(verdict_line(found, valve).removeprefix(line)) for each in remarks(found))


@pytest.mark.parametrize("at_s", [1.0, 7.6, 10.0, 17.0])
def test_a_stem_that_sticks_at_an_instant_fails(at_s: float) -> None:
    played, found = stroked(**sticking(at_s))
    assert found.verdict is Verdict.FAILED
    assert found.stop is not None
    assert found.stop.cause is Cause.STUCK
    assert START_M - min(played.stem_m) < 0.0127 + 0.05 * 0.127


def test_a_stem_that_sticks_after_the_stroke_passes() -> None:
    assert stroked(**sticking(18.0))[1].verdict is Verdict.PASSED


def test_a_weak_spring_does_not_change_the_mean_of_both_breakaways() -> None:
    _, found = stroked(process={"force_n": 150.0})
    assert found.out_n < 0.95 * STATIC_N < 1.05 * STATIC_N < found.back_n
    assert found.static_n == pytest.approx(STATIC_N, rel=0.004)


def test_opening_strokes_the_other_way() -> None:
    played, found = stroked(stroke={"direction": "opening"})
    assert found.verdict is Verdict.PASSED
    assert max(played.stem_m) - START_M == pytest.approx(0.0127, abs=2e-4)


def test_a_stroke_shorter_than_the_natural_jump_is_predicted_and_told() -> None:
    played, found = stroked(stroke={"stroke_of_span": 0.02})
    assert found.verdict is Verdict.PASSED
    assert START_M - min(played.stem_m) == pytest.approx(JUMP_M, abs=4e-4)
    assert any("jumps by 5.4 mm at its breakaway: the stroke cannot be smaller" in line for line in remarks(found))


@pytest.mark.parametrize(
    ("stroke", "start_m", "text"),
    [
        ({"stroke_of_span": 0.5}, 0.08, "cannot take the stem to 16.5 mm"),
        ({"direction": "opening", "approach": False}, 0.13, "would end at a stop: begin elsewhere"),
    ],
)
def test_a_stroke_that_can_be_done_nowhere_or_may_not_be_elsewhere_moves_nothing(
    stroke: dict[str, Any], start_m: float, text: str
) -> None:
    valve = {"initial_position_m": start_m}
    played = play(configured(stroke_test=stroke), plant_settings("noise-free", {"valve": valve}))
    assert played.result is not None
    assert played.result.verdict is Verdict.ABORTED
    assert played.result.stop is not None
    assert text in played.result.stop.why
    assert max(played.stem_m) == min(played.stem_m) == start_m


LOW_M, HIGH_M = 0.0652, 0.1000
"""Where a stroke of 12.7 mm can begin, closing: its end not below (4 mA·B + F_c)/K, its start not above
(20 mA·B - F_c)/K. Opening, the upper end is a stroke lower."""


@pytest.mark.parametrize(
    ("start_m", "stroke", "goal_m", "left_m"),
    [
        (0.010, {}, LOW_M + 0.00635, LOW_M + 0.00635),  # 4 mA do not bring it back
        (0.060, {}, LOW_M + 0.00635, 0.060),
        (0.095, {"direction": "opening"}, HIGH_M - 0.0127 - 0.00635, 0.095),
    ],
    ids=["the guide's", "near the lower end", "near the upper end"],
)
def test_a_valve_whose_stroke_is_not_possible_here_moves_to_where_it_is_and_back_as_far_as_it_can(
    start_m: float, stroke: dict[str, Any], goal_m: float, left_m: float
) -> None:
    played, found = stroked(valve={"initial_position_m": start_m}, stroke=stroke)
    assert found.verdict is Verdict.PASSED
    assert found.found_m == pytest.approx(start_m, abs=1e-4)
    assert found.start_m == pytest.approx(goal_m, abs=0.01 * 0.127)
    assert found.static_n == pytest.approx(STATIC_N, rel=0.004)
    assert abs(found.back_m - found.start_m) < 0.005 * 0.127
    assert found.left_m == pytest.approx(played.stem_m[-1], abs=2e-4)
    assert played.stem_m[-1] == pytest.approx(left_m, abs=0.01 * 0.127)
    assert remarks(found)[0].startswith(f"first moved from {start_m * 1e3:.1f} mm to ")


def test_a_person_who_stops_the_way_to_the_start_of_the_stroke_ends_it_and_a_host_gets_its_setpoint() -> None:
    valve = {"initial_position_m": 0.060}
    played, found = stroked(valve=valve, after=lambda number: number == 230)
    assert found.verdict is Verdict.ABORTED
    assert found.cause == "stopped by the guard or a person"
    assert played.stem_m[-1] == pytest.approx(0.060, abs=0.01 * 0.127)
    host = Host(230, Setpoint(0.09))
    held = [Setpoint(0.060)]
    played, found = stroked(valve=valve, host=lambda n: host(n) if n >= 230 else (held if n % 10 == 0 else ()))
    assert found.cause == "new setpoint"
    assert played.stem_m[-1] == pytest.approx(0.09, abs=0.01 * 0.127)


def test_a_host_that_holds_the_old_place_does_not_end_a_test_that_began_elsewhere() -> None:
    _, found = stroked(
        valve={"initial_position_m": 0.060}, host=lambda number: (Setpoint(0.060),) if number % 10 == 0 else ()
    )
    assert found.verdict is Verdict.PASSED


def test_a_stroke_beyond_the_limit_ends() -> None:
    """The spring is half as stiff as configured: the stem runs ahead."""
    valve = {"spring_rate_n_per_m": 0.5 * SPRING_N_PER_M, "initial_position_m": 0.064}
    _, found = stroked(valve=valve, stroke={"stroke_of_span": 0.08, "direction": "opening"})
    assert found.stop is not None
    assert found.stop.cause in {Cause.BEYOND, Cause.OFF_COURSE}


class Host:
    """A host that sends a setpoint every 10 periods, and something else from one period on."""

    def __init__(self, at: int, *then: Message) -> None:
        self.at, self.then = at, then

    def __call__(self, number: int) -> tuple[Message, ...]:
        if number >= self.at:
            return self.then if (number - self.at) % 10 == 0 else ()
        return (Setpoint(START_M),) if number % 10 == 0 else ()


@pytest.mark.parametrize("at", [500, *slow(50, 750, 850, 1050, 1650)])
def test_a_new_setpoint_is_obeyed_in_its_period_with_all_the_current(at: int) -> None:
    played, found = stroked(host=Host(at, Setpoint(0.0)))
    assert found.verdict is Verdict.ABORTED
    assert found.cause == "new setpoint"
    assert played.stopped == at
    assert set(played.sent_ma[at:]) == {4.0}


def test_a_new_setpoint_inside_the_travel_is_reached_by_the_law() -> None:
    played, found = stroked(host=Host(750, Setpoint(0.07)))
    assert found.cause == "new setpoint"
    assert played.stopped == 750
    assert played.stem_m[-1] == pytest.approx(0.07, abs=0.01 * 0.127)


def test_a_setpoint_that_trembles_and_the_one_of_the_start_end_nothing() -> None:
    assert stroked(host=Host(750, Setpoint(START_M + 0.0005)))[1].verdict is Verdict.PASSED


@pytest.mark.parametrize("off_m", [-0.01, 0.01])
def test_a_first_reading_that_is_far_off_is_no_new_setpoint(off_m: float) -> None:
    test = stroke_test_of(configured())
    memory = test.begin(START_M + off_m)
    for number in range(100):
        measured_m = START_M + (0.0 if number else off_m)
        memory, _ = test.advance(memory, Observation(measured_m, 12.0, PERIOD_S, START_M, number * PERIOD_S))
    assert memory.stop is None
    assert memory.asked_m == START_M


def test_a_host_that_asks_for_another_place_from_the_begin_gets_it_before_any_stroke() -> None:
    played, found = stroked(host=Host(0, Setpoint(0.06)))
    assert found.cause == "new setpoint"
    assert played.stopped is not None
    assert played.stopped * PERIOD_S < 0.2
    assert max(played.stem_m) - START_M < 0.05 * 0.127
    assert played.stem_m[-1] == pytest.approx(0.06, abs=0.01 * 0.127)


@pytest.mark.parametrize(
    ("message", "words"),
    [
        (Setpoint(START_M, HostRequest.DISARM), "READY, disarmed"),
        (ManualCurrent(12.0), "MANUAL, manual"),
    ],
)
def test_a_disarming_and_manual_mode_end_it_in_their_period(message: Message, words: str) -> None:
    played, found = stroked(host=Host(800, message))
    assert found.verdict is Verdict.ABORTED
    assert found.cause == f"ended by the guard: {words}"
    assert played.stopped == 800
    assert played.sent_ma[800] == (None if "READY" in words else 12.0)


def test_missing_feedback_ends_it_and_the_stem_is_brought_back() -> None:
    played, found = stroked(hears=lambda number: not 800 <= number < 806)
    assert found.verdict is Verdict.ABORTED
    assert found.stop is not None
    assert "feedback stale" in found.stop.why
    assert off_m(played) < 0.005 * 0.127


def test_lost_readings_change_no_value() -> None:
    _, found = stroked(hears=lambda number: number % 7 < 5 or not 950 < number < 1100)  # in the pause
    assert found.verdict is Verdict.PASSED
    assert found.static_n == pytest.approx(STATIC_N, rel=0.004)
    assert START_M - found.furthest_m == pytest.approx(0.0127, abs=3e-4)
    assert min(place_m for _, place_m, _ in found.trace) > 0.066


def test_feedback_that_stays_away_ends_it_by_the_guard() -> None:
    played, found = stroked(hears=lambda number: number < 800)
    assert found.cause == "ended by the guard: FAILSAFE, feedback stale"
    assert played.stopped == 800 + 3  # [guard] feedback_hold_periods
    assert len(played.stem_m) == 801 + 10  # [guard] feedback_failsafe_periods


@pytest.mark.parametrize("at", [100, 700, 810, 850, 1100, 1700])
def test_a_person_who_stops_it_gets_the_stem_back(at: int) -> None:
    played, found = stroked(after=lambda number: number == at)
    assert found.verdict is Verdict.ABORTED
    assert found.cause == "stopped by the guard or a person"
    assert off_m(played) < 0.005 * 0.127


def test_times_without_motion_and_of_the_whole_test_end_it() -> None:
    assert stroked(stroke={"breakaway_s": 4.0})[1].cause == "no motion in time"
    assert stroked(stroke={"breakaway_s": 5.5, "total_s": 10.0})[1].cause == "total time"


def test_the_report_names_verdict_values_and_what_the_test_does_not_show() -> None:
    _, found = stroked()
    valve = configured().valve
    document = json.loads(json.dumps(as_json(found, valve, configured().stroke_test), allow_nan=False))
    assert document["verdict"] == "passed"
    assert document["stop"] is None
    assert document["remarks"][-1] == NO_CREDIT
    assert "no safety integrity level" in NO_CREDIT or "earns no safety integrity level" in NO_CREDIT
    assert verdict_line(found, valve) == "FV-101: stroke test passed"
    assert document["quantities"]["breakaway, mean"] == found.static_n
    assert len(document["trace"]) <= 400
    _, worse = stroked(1.1)
    table = quantity_table([row.as_json() for row in rows(worse)], compared(worse, document))
    changes = {cells[0]: cells[-1] for cells in table.rows if cells[-1] != "–"}
    assert list(changes) == ["breakaway, mean", "lag", "time out", "time back"]
    assert float(changes["breakaway, mean"].rstrip("%")) == pytest.approx(10.0, abs=0.3)


def test_the_picture_has_travel_and_current_of_the_stroke(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    played, _ = stroked()
    monkeypatch.setattr("positioner.cli.stroke_test.outcome_of", lambda *_: (played.memory, ""))
    path = write_configuration(tmp_path, BusAddress(interface="virtual", channel="none"))
    assert (
        main(["stroke-test", "--config", str(path), "--yes", "--picture", str(tmp_path / "stroke.png")]) == ExitCode.OK
    )
    assert f"picture: {tmp_path / 'stroke.png'}\n" in capsys.readouterr().err
    assert (tmp_path / "stroke.png").read_bytes()[:4] == b"\x89PNG"
    drawn = (tmp_path / "stroke.svg").read_text(encoding="utf-8")
    for words in ("FV-101: stroke test passed", "Travel during the stroke", "Current during the stroke", "time, s"):
        assert words in drawn


def test_what_a_test_did_not_come_to_is_not_known() -> None:
    _, found = stroked(2.0)
    document = as_json(found, configured().valve, configured().stroke_test)
    assert document["quantities"]["lag"] is None
    assert document["stop"]["cause"] == "stuck, breakaway too high"
    assert [row.name for row in rows(found) if not row.seen][:2] == ["stroke", "natural jump, seen"]
    assert math.isnan(found.static_n)
    assert Phase.OUT in dict.fromkeys(phase for phase, _ in stroked(2.0)[0].memory.began)  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("stroke", "text"),
    [
        ({"breakaway_high": 1.5}, "breakaway_high must not exceed stuck_of_reference"),
        ({"total_s": 20.0}, "total_s must exceed breakaway_s"),
        ({"stroke_of_span": 0.9}, "stroke_of_span"),
    ],
)
def test_limits_in_the_wrong_order_are_refused(stroke: dict[str, Any], text: str) -> None:
    with pytest.raises(ConfigurationError, match=text):
        configured(stroke_test=stroke)
