"""The step response test of emulated valves: closed forms, and the true positions beside the readings."""

from __future__ import annotations

import json
import math
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
import pytest
from step_plant import CLEAN, HIGH, LOW, STARTS_M, Played, make_test, play

from positioner.commissioning.step.curves import curves
from positioner.commissioning.step.limits import StepTestSettings, broken
from positioner.commissioning.step.memory import StepMemory, repeats_needed
from positioner.commissioning.step.plan import wait_s_of
from positioner.commissioning.step.report import SIZE_HEAD, as_json, remarks, size_rows
from positioner.commissioning.step.response import crossing, extreme, instant, onset
from positioner.commissioning.step.result import StepResult, StepTestError, result_of
from positioner.commissioning.step.sizes import SizeRow, Spread, regions_of
from positioner.inputs.table import SettingsTable
from positioner.values import replace

if TYPE_CHECKING:
    from positioner.commissioning.step.procedure import StepTest

SPAN_M = 0.127
BREAKAWAY_S, BREAKAWAY_C = 1707.7, 1423.0
SIGNAL_N = 16.0 * 333.637


@cache
def open_loop() -> tuple[Played, StepResult]:
    test = make_test("paper", LOW, "hold", sizes=(0.1, 0.65, 0.8), repeats=2, wait_s=0.5, ladder=0.005)
    played = play(test, "paper", LOW)
    return played, result_of(played.memory, test)


@cache
def closed_loop() -> tuple[Played, StepResult]:
    test = make_test("paper", LOW, "nmpc", sizes=(0.01, 0.1), repeats=2, wait_s=0.5, ladder=0.002)
    played = play(test, "paper", LOW)
    return played, result_of(played.memory, test)


def test_an_exponential_crosses_each_level_where_its_closed_form_says() -> None:
    times = np.arange(2000) * 1.0
    clean = 1.0 - np.exp(-times / 40.0)
    noisy = clean + 0.05 * np.random.default_rng(3).standard_normal((60, len(times)))
    for level in (0.632, 0.865):
        truth = -40.0 * math.log(1.0 - level)
        assert crossing(clean, level, 0.0) == pytest.approx(truth, abs=0.02)
        found = np.array([crossing(each, level, 0.05) for each in noisy])
        assert np.median(found) == pytest.approx(truth, abs=2.0)
        assert 0.3 < found.std() < 8.0


def test_around_a_level_a_parabola_is_more_exact_than_the_regression_alone() -> None:
    times = np.arange(800) * 1.0
    rise = 1.0 - np.exp(-times / 40.0)
    noisy = rise + 0.05 * np.random.default_rng(4).standard_normal((60, len(times)))
    for part in (0.632, 0.865):
        truth = -40.0 * math.log(1.0 - part)
        alone = np.array([crossing(each, part, 0.05) - truth for each in noisy])
        found = np.array([instant(each, part, 1.0, 0.05) - truth for each in noisy])
        assert instant(rise, part, 1.0, 0.0) == pytest.approx(truth, abs=0.02)
        assert abs(float(found.mean())) < 0.8
        assert 0.1 < found.std() < 0.85 * alone.std()


def test_a_jump_through_the_level_is_no_parabola() -> None:
    # rests at 0.46 and 0.66 of the step, and a jump between them
    rise = np.concatenate([np.linspace(0.0, 0.46, 10), np.full(30, 0.46), np.full(30, 0.66), np.full(400, 1.0)])
    noisy = rise + 0.005 * np.random.default_rng(5).standard_normal((40, len(rise)))
    truth = crossing(rise, 0.632, 0.0)
    assert 39.0 < truth < 40.0
    found = np.array([instant(each, 0.632, 1.0, 0.005) for each in noisy])
    assert float(np.abs(found - truth).max()) < 1.5


def test_a_stem_that_rests_just_below_a_level_passes_it_when_it_moves_on() -> None:
    # for 60 samples it rests half a standard deviation below it: single readings are beyond it; then the stem slips
    times = np.maximum(np.arange(600) - 70.4, 0.0)
    rise = np.minimum(np.minimum(0.1 * np.arange(600), 0.8625) + 0.01 * times * times, 1.0)
    truth = 70.4 + math.sqrt((0.865 - 0.8625) / 0.01)
    noisy = rise + 0.005 * np.random.default_rng(7).standard_normal((200, len(rise)))
    alone = np.array([crossing(each, 0.865, 0.005) - truth for each in noisy])
    found = np.array([instant(each, 0.865, 1.0, 0.005) - truth for each in noisy])
    assert instant(rise, 0.865, 1.0, 0.0) == pytest.approx(truth, abs=0.3)
    assert abs(float(np.median(found))) < 0.5
    assert float(np.mean(np.abs(found) < 1.0)) > 0.95
    assert float(np.mean(np.abs(alone) < 1.0)) < 0.8


def test_the_onset_of_a_slow_start_is_more_exact_than_the_regression_alone() -> None:
    # rests, leaves its rest with a kink and goes on faster and faster, as a stem with much viscous friction does
    times = np.maximum(np.arange(600) - 60.4, 0.0)
    rise = np.minimum(0.4 * times + 0.02 * times * times, 400.0)
    level, truth = 2.0, 60.4 + (math.sqrt(0.16 + 0.16) - 0.4) / 0.04
    noisy = rise + np.random.default_rng(6).standard_normal((200, len(rise)))
    alone = np.array([crossing(each, level, 1.0) - truth for each in noisy])
    found = np.array([onset(each, level, 400.0, 1.0) - truth for each in noisy])
    assert onset(rise, level, 400.0, 0.0) == pytest.approx(truth, abs=0.02)
    assert abs(float(found.mean())) < 0.2
    assert 0.2 < found.std() < 0.75 * alone.std()
    assert np.abs(found).max() < 6.0


def test_a_level_counts_as_crossed_at_the_first_time_even_where_the_stem_falls_back() -> None:
    wave = np.concatenate([np.linspace(0.0, 1.2, 61), np.full(40, 0.5), np.full(300, 1.0)])
    noise = 0.02 * np.random.default_rng(1).standard_normal(len(wave))
    assert crossing(wave, 0.86, 0.0) == pytest.approx(43.0, abs=1e-9)
    assert crossing(wave + noise, 0.86, 0.02) == pytest.approx(43.0, abs=2.0)


def test_an_overshoot_is_that_of_the_rests_and_noise_makes_none() -> None:
    noise = 0.05 * np.random.default_rng(2).standard_normal((40, 1000))
    flat = np.ones(1000)
    over = np.concatenate([np.full(100, 1.08), np.full(900, 1.0)])
    assert extreme(over, 0.0) == 1.08
    found = np.array([extreme(over + each, 0.05) for each in noise])
    assert np.median(found) == pytest.approx(1.08, abs=0.005)
    assert max(extreme(flat + each, 0.05) for each in noise[:20]) < 1.01
    assert extreme(flat + noise[0], 0.0) > 1.1


def test_in_open_loop_the_times_are_those_of_the_poles() -> None:
    _, result = open_loop()
    for row in result.rows[2:]:
        assert row.moved == row.count == 2
        assert row.spread("t63_s").median == pytest.approx(12.13e-3, abs=0.7e-3)
        assert row.spread("t86_s").median == pytest.approx(21.01e-3, abs=1e-3)
        assert row.spread("overshoot").high < 0.005
        slides_m = (16.0 * row.size * 333.637 - 2.0 * BREAKAWAY_C) / 52538.0
        assert row.spread("gain").median == pytest.approx(slides_m / (row.size * SPAN_M), rel=0.01)


def test_a_curve_begins_before_the_step_and_ends_after_two_and_a_half_t86() -> None:
    played, result = open_loop()
    found = curves(played.memory.responses, result)
    assert [each["size"] for each in found] == [each.size for each in played.memory.responses]
    for each, response in zip(found, played.memory.responses, strict=True):
        times = np.array(each["time_s"])
        if result.regions[response.size] == "A":
            assert times[-1] == pytest.approx(0.5, abs=0.02), "the whole wait, where nothing moved"
            continue
        assert np.diff(times) == pytest.approx(np.full(len(times) - 1, 1e-3), abs=1e-9)
        t86_s = max(row.spread("t86_s").median for row in result.rows if row.size == response.size)
        assert times[-1] == pytest.approx(2.5 * t86_s, abs=2e-3)
        assert times[0] == pytest.approx(-0.25 * 2.5 * t86_s, abs=2e-3)
        before = np.array(each["part"])[times < 0.0]
        assert float(np.abs(before.mean())) < 0.01, "at rest"
        truth = np.array(response.measured_m)[: len(times) - len(before)]
        parts = response.direction * (truth - response.before_m) / abs(response.final_m - response.before_m)
        assert np.array(each["part"])[times >= 0.0] == pytest.approx(parts, abs=1e-4)


@pytest.mark.parametrize("part", [0.632, 0.865])
def test_between_two_readings_an_instant_has_the_uncertainty_of_the_sampling(part: float) -> None:
    # a stem that slips between two readings: the instant is anywhere between them
    phases = np.linspace(0.01, 0.99, 99)
    jumps = [np.where(np.arange(200) >= 20.0 + phase, 1.0, 0.0) for phase in phases]
    errors = [abs(instant(each, part, 1.0, 0.0) - 20.0 - phase) for each, phase in zip(jumps, phases, strict=True)]
    assert 0.6 < max(errors) < 1.0


def test_a_time_is_told_with_its_uncertainty_and_the_repeats_where_they_differ_by_more() -> None:
    spread, near = Spread(0.0121, 0.0118, 0.0245, 3), Spread(0.00031, 0.0, 0.00049, 3)
    nothing = Spread.of([])
    row = SizeRow(0.02, 1.0, 3, 3, (near, near, spread, nothing, Spread(0.01, 0.0, 0.2, 3), Spread(1.0, 0.9, 1.1, 3)))
    cells = {
        period_s: size_rows(replace(open_loop()[1], rows=(row,), regions={0.02: "C"}, period_s=period_s))[0][3:]
        for period_s in (0.005, 0.0001, 0.02)
    }
    assert cells[0.005] == (*("0.3 ±5",) * 2, "12.1 ±5 (11.8–24.5)", "–", "1.00 (0.00–20.0)", "1.00 (0.90–1.10)")
    assert cells[0.0001][1:3] == ("0.31 ±0.1 (0.00–0.49)", "12.10 ±0.1 (11.80–24.50)")
    assert cells[0.02][1:3] == ("0 ±20", "12 ±20")
    assert as_json(open_loop()[1], "v", ())["time_uncertainty_s"] == 0.001


def test_a_single_repeat_has_no_parentheses() -> None:
    alone = Spread(0.0121, 0.0121, 0.0121, 1)
    row = SizeRow(0.02, 1.0, 1, 1, (alone,) * 4 + (Spread(0.01, 0.01, 0.01, 1), Spread(1.02, 1.02, 1.02, 1)))
    (cells,) = size_rows(replace(open_loop()[1], rows=(row,), regions={0.02: "C"}, period_s=0.005))
    assert cells[3:] == (*("12.1 ±5",) * 4, "1.00", "1.02")


def test_a_step_inside_the_dead_band_moves_nothing_and_is_in_region_a() -> None:
    _, result = open_loop()
    assert result.regions[0.1] == "A"
    for row in result.rows[:2]:
        assert row.moved == 0
        assert row.spread("t86_s").count == 0
    first = size_rows(result)[0]
    assert first == ("10 up", "0/2", "A", *("–" for _ in SIZE_HEAD[3:]))


def test_in_open_loop_dead_band_and_resolution_are_those_of_the_friction() -> None:
    _, result = open_loop()
    for direction in (1.0, -1.0):
        dead_band, resolution = result.band("dead_band", direction), result.band("resolution", direction)
        assert dead_band is not None
        assert resolution is not None
        assert dead_band.median == pytest.approx((BREAKAWAY_S + BREAKAWAY_C) / SIGNAL_N, abs=0.005)
        assert dead_band.low <= (BREAKAWAY_S + BREAKAWAY_C) / SIGNAL_N <= dead_band.high
        assert dead_band.high - dead_band.low == pytest.approx(0.005, abs=1e-9)
        assert resolution.median == pytest.approx((BREAKAWAY_S - BREAKAWAY_C) / SIGNAL_N, abs=0.005)


def test_a_fine_ladder_without_noise_shows_them_to_its_own_step() -> None:
    test = make_test("paper", CLEAN, "hold", 0.004, sizes=(0.8,), repeats=1, wait_s=0.4, ladder=0.0002)
    played = play(test, "paper", CLEAN)
    result = result_of(played.memory, test)
    for direction in (1.0, -1.0):
        dead_band, resolution = result.band("dead_band", direction), result.band("resolution", direction)
        assert dead_band is not None
        assert resolution is not None
        assert dead_band.median == pytest.approx((BREAKAWAY_S + BREAKAWAY_C) / SIGNAL_N, abs=2e-4)
        assert resolution.median == pytest.approx((BREAKAWAY_S - BREAKAWAY_C) / SIGNAL_N, abs=2e-4)


def test_in_closed_loop_the_figures_are_those_of_the_true_positions() -> None:
    played, result = closed_loop()
    truths: dict[tuple[float, float], list[tuple[float, float]]] = {}
    for response, (before_m, final_m, after_m) in zip(played.memory.responses, played.true_steps(), strict=True):
        gone = response.direction * (after_m - before_m)
        step_m = response.direction * (final_m - before_m)
        passed = int(np.argmax(gone > 0.865 * step_m))
        truths.setdefault((response.size, response.direction), []).append((passed, step_m))
    for row in result.rows:
        times, steps = zip(*truths[row.size, row.direction], strict=True)
        assert 1e3 * row.spread("t86_s").median == pytest.approx(np.median(times) - 0.5, abs=1.5)
        assert row.spread("gain").median == pytest.approx(np.median(steps) / (row.size * SPAN_M), abs=0.01)
        assert row.spread("gain").median == pytest.approx(1.0, abs=0.12 if row.size < 0.1 else 0.02)
        assert result.regions[row.size] in ({"B", "C"} if row.size < 0.1 else {"C"})


def test_the_stem_is_back_at_the_end() -> None:
    for played, _ in (open_loop(), closed_loop()):
        assert played.true_m[-1] == pytest.approx(STARTS_M["paper"], abs=0.005 * SPAN_M)


@pytest.mark.parametrize("law", ["hold", "nmpc"])
def test_an_abort_brings_the_stem_back_and_there_is_no_result(law: str) -> None:
    def aborted(test: StepTest, memory: StepMemory, number: int) -> StepMemory:
        return test.abort(memory, "stopped") if number == 2_600 else memory

    test = make_test("paper", LOW, law, sizes=(0.1,) if law == "nmpc" else (0.8,), wait_s=0.5)
    played = play(test, "paper", LOW, each=aborted)
    assert test.progress(played.memory).aborted == "stopped"
    assert abs(played.true_m[2_600] - STARTS_M["paper"]) > 0.02 * SPAN_M
    assert played.true_m[-1] == pytest.approx(STARTS_M["paper"], abs=0.005 * SPAN_M)
    assert len(played.true_m) < 30_000


def test_a_step_that_the_noise_forbids_is_refused_with_the_repeats_it_would_take() -> None:
    assert repeats_needed(0.01, 0.0005 * SPAN_M, SPAN_M) == 1
    assert repeats_needed(0.001, 0.0005 * SPAN_M, SPAN_M) == 9
    test = make_test("paper", HIGH, "nmpc", sizes=(0.01, 0.1), repeats=1, wait_s=1.0, ladder=0.0)
    played = play(test, "paper", HIGH)
    result = result_of(played.memory, test)
    assert [each.size for each in played.memory.responses] == [0.1, 0.1]
    noise = 0.02 * 0.6
    ((size, count),) = result.refused
    assert size == 0.01
    assert count == pytest.approx((6.0 * noise / 0.01) ** 2, rel=0.15)
    assert f"the noise forbids steps of 1 %: they would take --repeats {count}" in remarks(result)
    alone = replace(test, plan=replace(test.plan, sizes=(0.01,)))
    with pytest.raises(StepTestError, match=rf"forbids every size: 1 % takes --repeats {count}"):
        result_of(replace(played.memory, responses=()), alone)


def row(size: float, moved: int, t86_s: float, gain: float, spread: float = 0.0) -> SizeRow:
    empty = Spread(0.0, 0.0, 0.0, moved)
    gains = Spread(gain, gain - spread, gain + spread, moved)
    return SizeRow(size, 1.0, 3, moved, (empty, empty, Spread(t86_s, t86_s, t86_s, moved), empty, empty, gains))


def test_the_regions_are_told_by_motion_proportion_and_speed() -> None:
    rows = (
        row(0.001, 0, math.nan, math.nan),
        row(0.002, 2, 0.1, 1.0),
        row(0.005, 3, 0.1, 1.0, 0.3),
        row(0.01, 3, 0.1, 1.0, 0.1),
        row(0.02, 3, 0.14, 1.0),
        row(0.1, 3, 0.7, 1.0),
    )
    assert "".join(regions_of(rows).values()) == "ABBCCD"


def test_limits_that_are_broken_are_told_and_those_that_are_kept_are_not() -> None:
    _, result = open_loop()
    assert broken(result, StepTestSettings()) == ()
    assert broken(result, StepTestSettings(dead_band=0.6, resolution=0.06, t86_s=0.022, overshoot=0.2)) == ()
    told = broken(result, StepTestSettings(dead_band=0.5, t86_s=0.02, gain_error=0.1, nominal_size_m=0.05))
    assert [line.split(":")[0] for line in told[:2]] == ["dead band up", "dead band down"]
    assert told[0] == "dead band up: 58.7 %, limit 1 %"
    rows = [each for each in result.rows if result.regions[each.size] in {"C", "D"}]
    assert len(told) == 2 + 2 * len(rows)
    assert any(line.startswith("T86 at 80 % up: 0.02") and line.endswith("s, limit 0.02 s") for line in told)
    assert issubclass(StepTestSettings, SettingsTable)


def test_the_document_is_plain_json_and_says_what_the_test_was() -> None:
    for _, result in (open_loop(), closed_loop()):
        document = json.loads(json.dumps(as_json(result, "FV-101", ("x",)), allow_nan=False))
        assert document["valve"] == "FV-101"
        assert [each["direction"] for each in document["sizes"]] == ["up", "down"] * len(result.regions)
        assert document["dead_band"]["up"]["count"] == 2
        assert document["broken"] == ["x"]
    assert open_loop()[1].law == "hold"
    assert as_json(open_loop()[1], "FV-101", ())["input"] == "signal"


def test_a_slow_valve_is_given_a_longer_wait() -> None:
    assert wait_s_of(make_test("paper", LOW, "hold").valve) == 2.0
    # F_v/K and the lag of graphite
    assert wait_s_of(make_test("graphite", LOW, "hold").valve) == pytest.approx(6.0 * (70501.0 / 206941.0 + 0.1))
