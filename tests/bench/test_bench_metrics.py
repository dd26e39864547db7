"""The bench's figures, against signals whose figures are known in closed form."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.optimize import brentq

from positioner.bench.metrics import REVERSAL_THRESHOLD_M, Trace, count_reversals, dwell_metrics, totals

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from positioner.bench.metrics import DwellMetrics

SPAN_M = 0.1
PERIOD_S = 1e-4


def samples_s(count: int, period_s: float) -> NDArray[np.float64]:
    return np.arange(count, dtype=np.float64) * period_s


def one_dwell(
    position_m: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    *,
    setpoint_m: float = 0.05,
    duration_s: float = 2.0,
    period_s: float = PERIOD_S,
) -> DwellMetrics:
    time_s = samples_s(round(duration_s / period_s), period_s)
    held = np.full_like(time_s, setpoint_m)
    trace = Trace(time_s=time_s, position_m=position_m(time_s), setpoint_m=held, current_ma=np.full_like(time_s, 12.0))
    (dwell,) = dwell_metrics(trace, (0.0, duration_s), SPAN_M)
    return dwell


def test_an_exponential_approach_settles_when_its_closed_form_says() -> None:
    # e = A exp(-t/tau): inside 1 % of 0.1 m from tau ln(A / 1 mm)
    dwell = one_dwell(lambda t: 0.05 - 0.02 * np.exp(-t / 0.1))
    assert dwell.settle_1pct_s == pytest.approx(0.1 * math.log(20.0), abs=PERIOD_S)
    assert dwell.settle_2pct_s == pytest.approx(0.1 * math.log(10.0), abs=PERIOD_S)
    assert dwell.overshoot_pct == 0.0
    assert dwell.reversals == 0
    assert not dwell.limit_cycle


def test_the_iae_of_an_exponential_is_its_integral() -> None:
    dwell = one_dwell(lambda t: 0.05 - 0.02 * np.exp(-t / 0.1))
    assert dwell.iae_mm_s == pytest.approx(20.0 * 0.1 * (1.0 - math.exp(-20.0)), rel=1e-3)


def test_the_iae_of_a_constant_error_covers_the_whole_dwell() -> None:
    dwell = one_dwell(lambda t: np.full_like(t, 0.052), period_s=0.1)
    assert dwell.iae_mm_s == pytest.approx(2.0 * 2.0)


def test_a_damped_sine_overshoots_and_settles_as_the_second_order_step_response() -> None:
    damping, natural_rad_per_s, step_m = 0.3, 20.0, 0.02
    damped_rad_per_s = natural_rad_per_s * math.sqrt(1.0 - damping**2)

    def error_m(t: NDArray[np.float64]) -> NDArray[np.float64]:
        decay = step_m * np.exp(-damping * natural_rad_per_s * t)
        phase = damped_rad_per_s * t
        return -decay * (np.cos(phase) + damping / math.sqrt(1.0 - damping**2) * np.sin(phase))

    dwell = one_dwell(lambda t: 0.05 + error_m(t), duration_s=3.0)

    peak_m = step_m * math.exp(-math.pi * damping / math.sqrt(1.0 - damping**2))
    assert dwell.overshoot_pct == pytest.approx(100.0 * peak_m / SPAN_M, rel=1e-4)

    # extremes are half a damped period apart; the last that leaves the band is followed by the last crossing
    half_s = math.pi / damped_rad_per_s
    last = max(k for k in range(40) if abs(error_m(np.array(k * half_s))) > 0.01 * SPAN_M)
    crossing_s = brentq(
        lambda t: abs(float(error_m(np.array(t)))) - 0.01 * SPAN_M, last * half_s, (last + 0.7) * half_s
    )
    assert dwell.settle_1pct_s == pytest.approx(crossing_s, abs=1.01 * PERIOD_S)

    # reversals go on until an extreme is less than the threshold from the next
    turns = sum(
        abs(error_m(np.array(k * half_s)) - error_m(np.array((k + 1) * half_s))) > REVERSAL_THRESHOLD_M
        for k in range(1, int(3.0 / half_s))
    )
    assert dwell.reversals == pytest.approx(turns, abs=1)
    assert dwell.reversals >= 8


def test_overshoot_counts_in_the_direction_of_the_move_only() -> None:
    closing = one_dwell(lambda t: np.where(t < 0.1, 0.07, np.where(t < 0.2, 0.045, 0.05)))
    assert closing.overshoot_pct == pytest.approx(5.0)
    short = one_dwell(lambda t: np.where(t < 0.1, 0.07, 0.055))
    assert short.overshoot_pct == 0.0


def test_a_ramp_travels_its_length_and_a_triangle_all_its_sides() -> None:
    ramp = one_dwell(lambda t: np.minimum(0.03 + 0.02 * t, 0.05))
    assert ramp.travel_mm == pytest.approx(20.0)
    assert ramp.ideal_travel_mm == pytest.approx(20.0)
    assert ramp.reversals == 0
    triangle = one_dwell(lambda t: 0.05 + 0.004 * np.abs(((t / 0.4) % 1.0) - 0.5))  # 2 s: five teeth of 2 + 2 mm
    assert triangle.travel_mm == pytest.approx(20.0, rel=1e-3)
    assert triangle.reversals == 9


def test_a_move_out_of_the_last_sample_of_the_dwell_before_belongs_to_the_new_dwell() -> None:
    time_s = samples_s(200, 0.01)
    second = time_s >= 1.0 - 1e-9
    trace = Trace(
        time_s=time_s,
        position_m=np.where(second, 0.05, 0.03),
        setpoint_m=np.where(second, 0.05, 0.03),
        current_ma=np.where(second, 13.0, 9.0),
    )
    first, last = dwell_metrics(trace, (0.0, 1.0, 2.0), SPAN_M)
    assert (first.travel_mm, first.command_variation_ma) == (0.0, 0.0)
    assert last.travel_mm == pytest.approx(20.0)
    assert last.ideal_travel_mm == pytest.approx(20.0)
    assert last.command_variation_ma == pytest.approx(4.0)
    assert last.settle_1pct_s == 0.0


@pytest.mark.parametrize(("swing_m", "reversals"), [(0.9e-6, 0), (1.1e-6, 19)])
def test_a_reversal_is_counted_above_the_threshold_and_not_below(swing_m: float, reversals: int) -> None:
    assert count_reversals(0.05 + swing_m * np.resize((0.0, 1.0), 21)) == reversals


def test_rounding_of_the_truth_frame_on_a_standing_stem_is_no_reversal() -> None:
    steps = np.random.default_rng(1).integers(-1, 2, 10_000)
    assert count_reversals(np.asarray(0.08 + 1e-8 * steps, dtype=np.float64)) == 0


def test_a_reversal_is_measured_from_the_very_turning_point() -> None:
    assert count_reversals(np.array([0.0, 2.0e-6, 2.9e-6, 1.8e-6])) == 1


def test_slow_motion_in_steps_below_the_threshold_still_turns_once() -> None:
    there = np.linspace(0.0, 1e-4, 1001)
    assert count_reversals(np.concatenate((there, there[::-1]))) == 1


@pytest.mark.parametrize(
    ("range_pct", "frequency_hz", "expected"),
    [
        (0.21, 2.0, True),  # four reversals late in the dwell
        (0.19, 2.0, False),  # too small
        (5.0, 0.25, False),  # half a period in two seconds: one reversal
    ],
)
def test_a_limit_cycle_needs_range_and_reversals(range_pct: float, frequency_hz: float, expected: bool) -> None:
    amplitude_m = range_pct / 100.0 * SPAN_M / 2.0
    assert one_dwell(lambda t: 0.05 + amplitude_m * np.sin(2 * np.pi * frequency_hz * t)).limit_cycle is expected


@pytest.mark.parametrize(("until_s", "expected"), [(0.75, False), (1.5, True)])
def test_a_cycle_that_ends_in_the_first_part_of_the_dwell_is_a_transient(until_s: float, expected: bool) -> None:
    dwell = one_dwell(lambda t: 0.05 + np.where(t < until_s, 0.002 * np.sin(2 * np.pi * 4.0 * t), 0.0))
    assert dwell.limit_cycle is expected


def test_a_dwell_that_ends_outside_the_band_never_settles() -> None:
    dwell = one_dwell(lambda t: 0.05 + np.full_like(t, 0.0015))
    assert dwell.settle_1pct_s is None
    assert dwell.settle_2pct_s == 0.0
    late = one_dwell(lambda t: np.where(t > 1.9, 0.055, 0.05))
    assert late.settle_1pct_s is None
    assert late.settle_2pct_s is None


@pytest.mark.parametrize(("duration_s", "window_s"), [(2.0, 0.5), (0.6, 0.3)])
def test_the_error_is_read_over_the_end_of_the_dwell_only(duration_s: float, window_s: float) -> None:
    begins_s = duration_s - window_s

    def position_m(t: NDArray[np.float64]) -> NDArray[np.float64]:
        # 9 mm off before the window, then half of it 1 mm above and half 3 mm below
        early, upper = t < begins_s - 1e-9, t < begins_s + window_s / 2.0 - 1e-9
        return np.asarray(0.05 + np.where(early, 0.009, np.where(upper, 0.001, -0.003)))

    dwell = one_dwell(position_m, duration_s=duration_s)
    assert dwell.mean_abs_error_pct == pytest.approx(2.0)
    assert dwell.max_abs_error_pct == pytest.approx(3.0)


def test_command_variation_sums_every_change_of_the_current() -> None:
    time_s = samples_s(1000, 1e-3)
    held = np.full_like(time_s, 0.05)
    square = Trace(
        time_s=time_s, position_m=held, setpoint_m=held, current_ma=np.where(time_s % 0.2 < 0.0999, 12.0, 14.0)
    )
    (dwell,) = dwell_metrics(square, (0.0, 1.0), SPAN_M)
    assert dwell.command_variation_ma == pytest.approx(9 * 2.0)


def test_missing_samples_leave_the_iae_and_the_settling_time_right() -> None:
    time_s = samples_s(2000, 1e-3)
    kept = np.random.default_rng(2).random(2000) > 0.05
    position_m = 0.05 - 0.02 * np.exp(-time_s / 0.1)
    held = np.full_like(time_s, 0.05)
    trace = Trace(time_s=time_s[kept], position_m=position_m[kept], setpoint_m=held[kept], current_ma=held[kept])
    (dwell,) = dwell_metrics(trace, (0.0, 2.0), SPAN_M)
    assert dwell.iae_mm_s == pytest.approx(2.0, rel=0.02)
    assert dwell.settle_1pct_s == pytest.approx(0.1 * math.log(20.0), abs=4e-3)


def test_edges_that_are_inexact_in_binary_cut_at_the_sample_they_name() -> None:
    period_s, dwell_s, dwells = 1e-3, 0.1, 30
    time_s = samples_s(3000, period_s)
    setpoint_m = 0.01 + 1e-3 * np.repeat(samples_s(30, 1.0), 100)
    trace = Trace(time_s=time_s, position_m=setpoint_m, setpoint_m=setpoint_m, current_ma=time_s)
    figures = dwell_metrics(trace, [k * dwell_s for k in range(dwells + 1)], SPAN_M)
    assert [round(dwell.setpoint_mm, 6) for dwell in figures] == [10.0 + k for k in range(dwells)]
    assert all(dwell.max_abs_error_pct == 0.0 and dwell.settle_1pct_s == 0.0 for dwell in figures)


def test_a_dwell_without_samples_is_refused() -> None:
    time_s = samples_s(100, 0.01)
    trace = Trace(time_s=time_s, position_m=time_s, setpoint_m=time_s, current_ma=time_s)
    with pytest.raises(ValueError, match="no samples between 1 and 2 s"):
        dwell_metrics(trace, (0.0, 1.0, 2.0), SPAN_M)


def test_totals_take_means_extremes_counts_and_sums_where_each_belongs() -> None:
    first = one_dwell(lambda t: 0.05 - 0.02 * np.exp(-t / 0.1))
    second = one_dwell(lambda t: 0.053 + 0.002 * np.sin(2 * np.pi * 2.0 * t))
    total = totals((first, second))
    assert total.dwells == 2
    assert total.mean_abs_error_pct == pytest.approx((first.mean_abs_error_pct + second.mean_abs_error_pct) / 2.0)
    assert total.worst_mean_abs_error_pct == second.mean_abs_error_pct
    assert total.max_abs_error_pct == pytest.approx(5.0)
    assert (total.unsettled_1pct, total.unsettled_2pct, total.limit_cycles) == (1, 1, 1)
    assert total.overshoot_pct == max(first.overshoot_pct, second.overshoot_pct)
    assert total.reversals == second.reversals == 8
    assert total.travel_mm == pytest.approx(first.travel_mm + second.travel_mm)
    assert total.travel_ratio == pytest.approx((20.0 + 32.0) / (20.0 + 3.0), rel=1e-3)
    assert total.iae_mm_s == pytest.approx(first.iae_mm_s + second.iae_mm_s)


def test_the_median_settling_time_counts_a_dwell_that_never_settles_as_the_latest() -> None:
    base = one_dwell(lambda t: 0.05 - 0.02 * np.exp(-t / 0.1))
    times: tuple[float | None, ...] = (0.3, None, 0.1)
    three = [replace(base, settle_1pct_s=time_s) for time_s in times]
    assert totals(three).median_settle_1pct_s == 0.3
    assert totals([*three, replace(base, settle_1pct_s=None)]).median_settle_1pct_s is None


def test_the_travel_ratio_of_a_run_that_asks_for_no_move_is_none() -> None:
    assert totals([one_dwell(lambda t: np.full_like(t, 0.05))]).travel_ratio is None


def test_there_are_no_totals_of_nothing() -> None:
    with pytest.raises(ValueError, match="no dwells"):
        totals(())
