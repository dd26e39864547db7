"""The force of the process: a preload, a spring, and noise of the stated size and bandwidth."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plant_cuts import whole_and_cut

from plant_emulator import valve
from plant_emulator.force import PushingForce
from plant_emulator.parameters import ProcessSettings
from plant_emulator.presets import plant_settings
from plant_emulator.process import disturbed, initial_noise_n
from positioner.errors import ConfigurationError

PAPER = plant_settings("paper")


def test_a_constant_force_and_a_gradient_are_a_preload_and_a_stiffer_spring() -> None:
    v = PAPER.valve
    same = plant_settings(
        "paper", {"valve": {"bench_set_n": 300.0, "spring_rate_n_per_m": 1.1 * v.spring_rate_n_per_m}}
    )
    pushed = plant_settings("paper", {"process": {"force_n": 300.0, "gradient_n_per_m": 0.1 * v.spring_rate_n_per_m}})
    theirs, ours = valve.initial_state(same, 0), valve.initial_state(pushed, 0)
    for current_ma in (7.0, 12.0, 9.0, 15.0, 5.0):
        theirs, ours = valve.step(same, theirs, current_ma, 0.007), valve.step(pushed, ours, current_ma, 0.007)
        assert ours.stem.position_m == pytest.approx(theirs.stem.position_m, abs=1e-12)
        assert ours.stem.velocity_m_per_s == pytest.approx(theirs.stem.velocity_m_per_s, abs=1e-9)
        assert valve.friction_n(pushed, ours) == pytest.approx(valve.friction_n(same, theirs), abs=1e-6)
    assert ours.stem.slips == 2


def test_a_process_that_is_stronger_than_the_spring_is_refused() -> None:
    with pytest.raises(ConfigurationError, match=r"process\.gradient_n_per_m must be at least -52438"):
        plant_settings("paper", "process.gradient_n_per_m = -52500.0")


def noise(bandwidth_hz: float, period_s: float, count: int) -> np.ndarray:
    process = ProcessSettings(noise_n=60.0, noise_bandwidth_hz=bandwidth_hz)
    now_n, values = initial_noise_n(process, 3), []
    for index in range(count):
        now_n, _ = disturbed(process, 3, now_n, index * period_s, ((PushingForce(0.0), period_s),))
        values.append(now_n)
    return np.array(values)


def test_the_noise_has_the_stated_size_and_bandwidth() -> None:
    # at 10 Hz it forgets in 16 ms: 40 s are 1250 independent pairs
    values = noise(10.0, 1e-3, 40_000)
    assert values.std() == pytest.approx(60.0, rel=0.05)
    assert values.mean() == pytest.approx(0.0, abs=6.0)
    for apart in (10, 20):
        correlation = float(np.corrcoef(values[apart:], values[:-apart])[0, 1])
        assert correlation == pytest.approx(math.exp(-math.tau * 10.0 * apart * 1e-3), abs=0.08)


def test_the_noise_acts_against_opening_as_part_of_the_force() -> None:
    process = ProcessSettings(noise_n=60.0)
    now_n, start_n = 0.0, initial_noise_n(process, 3)
    now_n, forces = disturbed(process, 3, start_n, 0.0, ((PushingForce(500.0, ((-90.0, 30.0),)), 0.02),))
    first, last = forces[0][0], forces[-1]
    assert first.at(0.0) == pytest.approx(410.0 - start_n, rel=1e-12)
    assert last[0].at(last[1]) == pytest.approx(500.0 - 90.0 * math.exp(-0.6) - now_n, rel=1e-12)
    assert sum(seconds for _, seconds in forces) == pytest.approx(0.02, rel=1e-12)
    for (before, seconds), (after, _) in pairwise(forces):
        assert before.at(seconds) == pytest.approx(after.at(0.0), rel=1e-12)  # the noise never jumps


def test_the_noise_of_a_seed_does_not_depend_on_the_steps() -> None:
    assert noise(10.0, 1e-3, 700)[69::70] == pytest.approx(noise(10.0, 0.07, 10), abs=1e-9)


def test_the_sine_acts_against_opening_and_is_drawn_within_half_a_percent() -> None:
    process = ProcessSettings(sine_n=300.0, sine_hz=0.2)
    farthest_n = 0.0
    for index in range(700):
        start_s = index * 0.01
        _, forces = disturbed(process, 3, 0.0, start_s, ((PushingForce(500.0), 0.01),))
        assert sum(seconds for _, seconds in forces) == pytest.approx(0.01, rel=1e-9)
        (force, seconds), true_n = forces[-1], 500.0 - 300.0 * math.sin(math.tau * 0.2 * (start_s + 0.01))
        farthest_n = max(farthest_n, abs(force.at(seconds) - true_n))
    assert 0.004 * 300.0 < farthest_n < 0.005 * 300.0


@pytest.mark.parametrize("seed", range(8))
def test_a_force_that_jumps_above_static_friction_frees_the_stem_at_once_whichever_way_the_noise_goes(
    seed: int,
) -> None:
    plant = plant_settings("paper", "process.noise_n = 100.0")
    state = valve.step(plant, valve.initial_state(plant, seed), 1.5747, 1e-3)
    assert state.stem.slips == 0
    assert valve.step(plant, state, 7.6, 1e-9).stem.slips == 1


commands = st.lists(st.tuples(st.floats(0.0, 24.0), st.sampled_from([1e-3, 5e-3, 0.05])), min_size=1, max_size=8)


@settings(max_examples=60, deadline=None)
@given(
    st.sampled_from(["paper", "frictionless", "stochastic", "graphite"]),
    st.sampled_from([0.0, 0.003]),
    st.sampled_from([0.0, 60.0, 400.0]),
    st.sampled_from([0.0, 300.0]),
    commands,
    st.integers(2, 30),
)
def test_no_cut_of_time_changes_a_motion_in_the_process(
    preset: str, lag_s: float, noise_n: float, sine_n: float, sequence: list[tuple[float, float]], pieces: int
) -> None:
    plant = plant_settings(
        preset,
        {
            "process": {
                "force_n": 200.0,
                "gradient_n_per_m": 3000.0,
                "noise_n": noise_n,
                "sine_n": sine_n,
                "sine_hz": 3.0,
            },
            "actuator": {"converter_time_constant_s": lag_s, "hysteresis_ma": 0.1, "dead_band_ma": 0.02},
        },
    )
    for whole, cut in whole_and_cut(plant, 2, sequence, pieces):
        assert abs(whole.stem.position_m - cut.stem.position_m) < 1e-8
        assert (whole.stem.slips, whole.stem.stops) == (cut.stem.slips, cut.stem.stops)
