"""The closed form of the motion against the matrix exponential, for all arrangements of poles; and the root finders."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scipy.linalg import expm

from plant_emulator.force import PushingForce
from plant_emulator.oscillator import Glide, Oscillator
from plant_emulator.roots import clear_time, crossing, first_event

MASS, SPRING = 1.361, 52538.0
CRITICAL = 2.0 * math.sqrt(SPRING * MASS)


def reference(
    damping: float, force: PushingForce, load: float, t: float, sensor_rate: float = 1.0
) -> tuple[float, float, float]:
    """Return x, v and a lagging reading after `t`, by the exponential of the system with its force as states.

    It starts at x = 0.03, v = -0.4, and the reading at 0.
    """
    count = 5 + len(force.decays)
    system = np.zeros((count, count))
    system[0, 1] = 1.0
    system[1, :2] = [-SPRING / MASS, -damping / MASS]
    system[1, 2:] = 1.0 / MASS
    system[1, 3] = 0.0
    system[2, 4] = force.ramp_n_per_s
    system[3, [0, 3]] = sensor_rate, -sensor_rate
    start = [0.03, -0.4, force.final_n - load, 0.0, 1.0]
    system[1, 4] = 0.0
    for index, (deviation_n, rate) in enumerate(force.decays, start=5):
        system[index, index] = -rate
        start.append(deviation_n)
    end = expm(system * t) @ start
    return float(end[0]), float(end[1]), float(end[3])


DAMPINGS = [0.0, 50.0, CRITICAL * (1 - 1e-9), CRITICAL, CRITICAL * (1 + 1e-4), 612.9, 70501.0]
RATES = [0.0, 5.0, 115.3387, 335.0, 1e4, "slow", "fast", "beside", "mean", "near the mean"]


def rate_of(name: float | str, oscillator: Oscillator) -> float:
    if not isinstance(name, str):
        return name
    return {
        "slow": -oscillator.slow,
        "fast": -oscillator.fast,
        "beside": -oscillator.slow * (1 + 1e-9),
        "mean": oscillator.decay,
        "near the mean": oscillator.decay * (1 + 9e-4),
    }[name]


@pytest.mark.parametrize("damping", DAMPINGS)
@pytest.mark.parametrize("rate", RATES)
def test_the_glide_is_the_matrix_exponential_of_the_motion(damping: float, rate: float | str) -> None:
    oscillator = Oscillator(MASS, damping, SPRING)
    rate_per_s = rate_of(rate, oscillator)
    force = PushingForce(3000.0, ((-1800.0, rate_per_s),) if rate_per_s else ())
    glide = Glide(oscillator, 0.03, -0.4, force, 1423.0)
    for t in (1e-7, 1e-4, 2e-3, 0.012, 0.03):
        x, v = glide.at(t)
        expected_x, expected_v, _ = reference(damping, force, 1423.0, t)
        assert x == pytest.approx(expected_x, abs=1e-10)
        assert v == pytest.approx(expected_v, abs=2e-8)


FORCES = [
    PushingForce(3000.0),
    PushingForce(3000.0, (), -40e3),
    PushingForce(3000.0, ((-1800.0, 115.3387),)),
    PushingForce(3000.0, ((-1800.0, 50.0), (700.0, 200.0))),
    PushingForce(3000.0, ((-1800.0, 50.0), (700.0, 200.0)), 60e3),
]


@pytest.mark.parametrize("damping", DAMPINGS)
@pytest.mark.parametrize("force", FORCES)
@pytest.mark.parametrize("sensor", [50.0, 200.0, 115.3387, 2000.0, "slow", "fast", "beside", "mean", "near the mean"])
def test_a_lagging_sensor_shows_the_matrix_exponential_of_motion_and_sensor(
    damping: float, force: PushingForce, sensor: float | str
) -> None:
    oscillator = Oscillator(MASS, damping, SPRING)
    rate = rate_of(sensor, oscillator)
    if rate == 0.0:
        return
    glide = Glide(oscillator, 0.03, -0.4, force, 1423.0)
    for t in (1e-7, 1e-4, 2e-3, 0.012, 0.03):
        expected_x, expected_v, shown = reference(damping, force, 1423.0, t, rate)
        x, v = glide.at(t)
        assert x == pytest.approx(expected_x, abs=1e-10)
        assert v == pytest.approx(expected_v, abs=2e-8)
        assert glide.lagged(t, rate) == pytest.approx(shown, abs=1e-9)


def test_jerk_and_snap_stay_within_their_bounds() -> None:
    equal = PushingForce(3000.0, ((-18e6, 90.0), (18e6 - 1800.0, 90.009)))
    forces = (PushingForce(3000.0, ((-1800.0, 90.0),)), FORCES[-1], equal)
    for damping, force in itertools.product((0.0, 100.0, 612.9, 5000.0), forces):
        glide = Glide(Oscillator(MASS, damping, SPRING), 0.03, -0.4, force, 1423.0)
        for t in (0.0, 0.004, 0.02):
            x, v = glide.at(t)
            a = glide.acceleration(t, x, v)
            jerk_bound, snap_bound = glide.jerk_bound(t, v, a, 0.05), glide.snap_bound(t, v, a, 0.05)
            jerks = []
            for later in np.linspace(t, t + 0.05, 2001).tolist():
                at_x, at_v = glide.at(later)
                jerks.append(glide.jerk(later, at_v, glide.acceleration(later, at_x, at_v)))
            assert max(map(abs, jerks)) <= jerk_bound * (1 + 1e-12)
            assert np.abs(np.gradient(jerks, 0.05 / 2000)).max() <= snap_bound * (1 + 1e-6)
            assert t > 0.0 or jerk_bound < 100.0 * max(map(abs, jerks))  # a far larger bound would be useless


def test_the_time_at_which_a_settling_force_passes_a_bound() -> None:
    rising = PushingForce(100.0, ((-80.0, 10.0),))
    assert rising.time_above(60.0) == pytest.approx(math.log(2.0) / 10.0)
    assert rising.at(rising.time_above(60.0)) == pytest.approx(60.0)
    assert rising.time_above(100.0) == math.inf
    assert rising.time_above(19.0) == 0.0
    assert rising.time_below(30.0) == 0.0
    falling = PushingForce(-100.0, ((80.0, 10.0),))
    assert falling.time_below(-60.0) == pytest.approx(math.log(2.0) / 10.0)
    assert falling.time_below(-100.0) == math.inf
    assert rising.after(0.05).at(0.02) == pytest.approx(rising.at(0.07), rel=1e-14)
    assert rising.slope(0.03) == pytest.approx((rising.at(0.03 + 1e-6) - rising.at(0.03 - 1e-6)) / 2e-6, rel=1e-6)


def test_the_first_of_two_brief_zeros_is_never_missed() -> None:
    # cos(t) + 0.99999 is below zero for 9 ms around t = π only
    def clear(t: float) -> float:
        return clear_time(math.cos(t) + 0.99999, -math.sin(t), 1.0)

    t, found = first_event(clear, 10.0)
    assert found
    assert t == pytest.approx(math.acos(-0.99999), abs=1e-9)
    assert first_event(clear, 3.0) == (3.0, False)


def test_a_quantity_with_a_constant_slope_is_clear_until_its_zero() -> None:
    assert clear_time(2.0, -4.0, 0.0) == 0.5
    assert clear_time(2.0, 4.0, 0.0) == math.inf
    assert clear_time(0.0, 3.0, 6.0) == 1.0
    assert clear_time(0.0, -3.0, 6.0) == 0.0
    assert clear_time(0.5, -1.0, 1.0) == pytest.approx(math.sqrt(2.0) - 1.0)


def test_a_crossing_is_found_to_a_rounding_error() -> None:
    assert crossing(lambda t: t**3 - 2.0, 0.0, 2.0) == pytest.approx(2.0 ** (1 / 3), abs=1e-12)
    assert crossing(lambda t: 1.0 - math.exp(t - 1.0), 0.0, 3.0) == pytest.approx(1.0, abs=1e-12)
    assert crossing(lambda t: t, 0.0, 1.0) == 0.0
    assert crossing(lambda t: t - 1.0, 0.0, 1.0) == 1.0
    assert (
        crossing(lambda t: t + 1e-18, 0.0, 1.0) == 0.0
    )  # no change of sign: the start is on the zero, but for rounding


def test_a_search_that_makes_no_progress_stops_before_any_event() -> None:
    t, found = first_event(lambda _: 2e-13, 1.0)
    assert not found
    assert 0.0 < t < 1e-9
