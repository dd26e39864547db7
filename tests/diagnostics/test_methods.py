"""The published methods on signals whose answer is known in closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from positioner.diagnostics.indirect import shapes
from positioner.diagnostics.indirect.bicoherence import bicoherence, ellipse_width, squared_bicoherence
from positioner.diagnostics.indirect.correlation import correlation
from positioner.diagnostics.indirect.hammerstein import models
from positioner.diagnostics.indirect.oscillation import half_cycles, oscillation_of
from positioner.diagnostics.indirect.symbols import symbols
from positioner.diagnostics.indirect.valve_model import stem_positions
from positioner.diagnostics.verdict import Verdict

Array = NDArray[np.float64]
PERIOD = 40
TIME = np.arange(50 * PERIOD)
SINE = np.sin(2.0 * math.pi * (TIME + 0.5) / PERIOD)


def triangle() -> Array:
    phase = (TIME + 0.5) / PERIOD
    return np.asarray(2.0 / math.pi * np.arcsin(np.sin(2.0 * math.pi * phase)))


def linear_series(count: int, seed: int) -> Array:
    """Return an AR(2) series of Gaussian noise, with a resonance."""
    noise = np.random.default_rng(seed).standard_normal(count + 100)
    values = [0.0, 0.0]
    for each in noise[2:].tolist():
        values.append(1.8 * values[-1] - 0.9 * values[-2] + each)
    return np.array(values[-count:])


def test_the_period_and_the_regularity_of_an_oscillation() -> None:
    noise = np.random.default_rng(1).standard_normal(TIME.size)
    found = oscillation_of(SINE + 0.1 * noise)
    assert found.period == pytest.approx(PERIOD, rel=0.02)
    assert found.regularity > 3.0
    assert oscillation_of(noise).regularity < 1.0


def test_half_cycles_are_half_a_period_and_positive() -> None:
    halves = half_cycles(SINE, PERIOD)
    assert len(halves) > 90
    assert {half.size for half in halves[2:-2]} <= {PERIOD // 2, PERIOD // 2 + 1}
    assert min(float(half[3:-3].min()) for half in halves) > 0.0


@pytest.mark.parametrize(("lag", "verdict"), [(PERIOD // 4, Verdict.YES), (PERIOD // 2, Verdict.NO)])
def test_horch_says_stiction_at_90_degrees_and_not_at_180(lag: int, verdict: Verdict) -> None:
    answer = correlation(np.roll(SINE, lag), SINE, PERIOD)
    assert answer.verdict is verdict
    assert answer.index == pytest.approx(1.0 if verdict is Verdict.YES else 0.0, abs=0.03)


def test_horch_is_undecided_between_his_limits() -> None:
    """At 45° the value at lag 0 is cos 45° of the largest: Δρ = (1 - cos 45°)/(1 + cos 45°) = 0.1716."""
    answer = correlation(np.roll(SINE, PERIOD // 8), SINE, PERIOD)
    assert answer.index == pytest.approx(0.1716, abs=0.02)
    assert answer.verdict is Verdict.UNDECIDED


def test_he_tells_a_triangle_from_a_sine() -> None:
    assert shapes.curve(half_cycles(triangle(), PERIOD), "OP").index > 0.9
    assert shapes.curve(half_cycles(SINE, PERIOD), "OP").index < 0.05
    few = shapes.curve(half_cycles(SINE, PERIOD)[:3], "OP")
    assert math.isnan(few.index)
    assert few.verdict is Verdict.UNDECIDED


def test_rossi_and_scali_tell_relay_and_triangle_from_a_sine() -> None:
    relay, level = [], 0.0
    for each in np.sign(np.sin(2.0 * math.pi * (TIME + 0.5) / PERIOD)).tolist():
        level += (each - level) / 8.0
        relay.append(level)
    assert shapes.relay(half_cycles(np.array(relay), PERIOD)).index > 0.8
    assert shapes.relay(half_cycles(triangle(), PERIOD)).index > 0.8
    assert shapes.relay(half_cycles(SINE, PERIOD)).index < -0.8


def test_the_areas_about_a_peak_are_in_the_ratio_of_the_triangle_they_come_from() -> None:
    """A triangle with its peak at the part p of its base has areas in the ratio p to 1 - p."""
    time = (np.arange(400) + 0.5) / 400.0
    late = np.minimum(time / 0.75, (1.0 - time) / 0.25)
    assert shapes.area([late] * 10).index == pytest.approx(3.0, rel=0.02)
    assert shapes.area([late] * 10).verdict is Verdict.YES
    assert shapes.area([late[::-1]] * 10).index == pytest.approx(1.0 / 3.0, rel=0.02)
    assert shapes.area([late[::-1]] * 10).verdict is Verdict.NO


def test_yamashita_counts_the_time_in_which_op_moves_and_pv_rests() -> None:
    """OP rests for 2 samples and moves for 8; PV answers with one jump in the last of the eight: 7 of 8 stick."""
    op = np.cumsum(np.tile([0.0] * 2 + [1.0] * 8 + [0.0] * 2 + [-1.0] * 8, 30))
    pv = np.cumsum(np.tile([0.0] * 9 + [5.0] + [0.0] * 9 + [-5.0], 30))
    assert symbols(op, pv).index == pytest.approx(7.0 / 8.0, abs=0.01)
    assert symbols(op, op).index == 0.0
    # a PV that jumps against OP does not fit: nothing of it counts
    assert symbols(op, -pv).index == pytest.approx(0.0, abs=0.01)


def test_a_linear_gaussian_series_has_a_bicoherence_below_its_limit() -> None:
    for seed in range(5):
        assert bicoherence(linear_series(4000, seed)).verdict is Verdict.NO


def test_a_series_with_phases_that_couple_has_a_bicoherence_above_it() -> None:
    linear = linear_series(4000, 9)
    assert bicoherence(linear + 0.2 * linear * linear / float(np.std(linear))).verdict is Verdict.YES
    squared, _ = squared_bicoherence(linear)
    assert 0.0 <= float(squared.min()) <= float(squared.max()) <= 1.0


def test_the_width_of_an_ellipse_is_that_of_two_sines() -> None:
    """OP of amplitude A at the phase φ to PV: at the centre the ellipse is 2·A·sin φ wide."""
    for phase in (0.3, 1.0, math.pi / 2.0):
        pv = np.sin(2.0 * math.pi * TIME / PERIOD + phase)
        assert ellipse_width(3.0 * np.sin(2.0 * math.pi * TIME / PERIOD), pv) == pytest.approx(6.0 * math.sin(phase))


def test_the_modelled_stem_rests_within_its_band_and_jumps_by_j() -> None:
    command = np.concatenate([np.linspace(0.0, 10.0, 1001), np.linspace(10.0, 0.0, 1001)])
    stem = stem_positions(command, np.array([4.0]), np.array([1.0]))[:, 0]
    jumps = np.diff(stem)
    assert command[np.flatnonzero(jumps)[0] + 1] == pytest.approx(2.5, abs=0.011)
    assert float(jumps.max()) == pytest.approx(1.0, abs=0.011)
    assert stem[1000] == pytest.approx(stem[1100], abs=1e-12)


@pytest.mark.parametrize("stick", [3.0, 6.0])
def test_a_process_behind_a_sticking_valve_shows_its_stick_band(stick: float) -> None:
    draw = np.random.default_rng(11)
    op = 50.0 + 5.0 * np.asarray(triangle()) + np.cumsum(0.05 * draw.standard_normal(TIME.size))
    stem = stem_positions(op, np.array([stick]), np.array([0.4 * stick]))[:, 0]
    pv = [0.0]
    for each in stem[:-1].tolist():
        pv.append(0.8 * pv[-1] + 0.2 * each + 0.02 * draw.standard_normal())
    found = models(op, np.array(pv), np.ones(TIME.size, dtype=np.bool_))
    assert (found.hammerstein.verdict, found.ratio.verdict) == (Verdict.YES, Verdict.YES)
    assert found.stick.low <= stick <= found.stick.high
    assert found.stick.half_width < 0.4 * stick


def test_a_linear_process_shows_none() -> None:
    draw = np.random.default_rng(12)
    op = 50.0 + 5.0 * np.asarray(triangle()) + np.cumsum(0.05 * draw.standard_normal(TIME.size))
    pv = [0.0]
    for each in op[:-1].tolist():
        pv.append(0.8 * pv[-1] + 0.2 * each + 0.02 * draw.standard_normal())
    found = models(op, np.array(pv), np.ones(TIME.size, dtype=np.bool_))
    assert Verdict.YES not in {found.hammerstein.verdict, found.ratio.verdict}


def test_a_controller_that_makes_op_of_pv_at_once_is_not_taken_for_the_process() -> None:
    """PI without a filter: OP is exactly a function of PV of the same sample, but no lag 0 is in the models."""
    draw = np.random.default_rng(13)
    op: list[float] = []
    pv: list[float] = []
    total = level = 0.0
    for _ in range(2000):
        level = 0.9 * level + 0.1 * (op[-1] if op else 0.0) + 0.1 * draw.standard_normal()
        total -= 0.05 * level
        pv.append(level)
        op.append(total - 0.8 * level)
    found = models(np.array(op), np.array(pv), np.ones(2000, dtype=np.bool_))
    assert Verdict.YES not in {found.hammerstein.verdict, found.ratio.verdict}
    assert abs(found.ratio.index) < 40.0
