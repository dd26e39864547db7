"""The actuator: its lag against the closed form, its dead time to the last digit."""

from __future__ import annotations

import math

import pytest

from plant_emulator import valve
from plant_emulator.actuator import DelayLine, commanded
from plant_emulator.presets import plant_settings

GAIN_PA_PER_MA = 5171.06775


def test_without_lag_the_pressure_is_the_current_times_its_gain() -> None:
    settings = plant_settings("paper")
    state = valve.step(settings, valve.initial_state(settings, 0), 7.3, 1e-4)
    assert state.actuator.pressure_pa == pytest.approx(GAIN_PA_PER_MA * 7.3, rel=1e-14)


@pytest.mark.parametrize("pieces", [1, 7, 100])
def test_the_pressure_fills_and_vents_exponentially_each_with_its_own_time(pieces: int) -> None:
    lags = {"fill_time_constant_s": 0.02, "vent_time_constant_s": 0.05}
    settings = plant_settings("paper", {"actuator": lags})
    state = valve.initial_state(settings, 0)
    start_pa = state.actuator.pressure_pa
    for _ in range(pieces):
        state = valve.step(settings, state, 10.0, 0.03 / pieces)
    filled_pa = GAIN_PA_PER_MA * 10.0 + (start_pa - GAIN_PA_PER_MA * 10.0) * math.exp(-0.03 / 0.02)
    assert state.actuator.pressure_pa == pytest.approx(filled_pa, rel=1e-12)
    for _ in range(pieces):
        state = valve.step(settings, state, 2.0, 0.03 / pieces)
    vented_pa = GAIN_PA_PER_MA * 2.0 + (filled_pa - GAIN_PA_PER_MA * 2.0) * math.exp(-0.03 / 0.05)
    assert state.actuator.pressure_pa == pytest.approx(vented_pa, rel=1e-12)


def test_the_slip_comes_when_the_lagging_pressure_reaches_the_breakaway_force() -> None:
    settings = plant_settings("paper", {"actuator": {"fill_time_constant_s": 0.1}})
    v = settings.valve
    start = valve.initial_state(settings, 0)
    gain = v.diaphragm_area_m2 * v.pressure_gain_pa_per_ma
    target_n, start_n = gain * 10.0, v.spring_rate_n_per_m * 0.01
    slip_s = 0.1 * math.log((target_n - start_n) / (target_n - start_n - v.static_friction_n))
    assert valve.step(settings, start, 10.0, slip_s - 1e-9).stem.slips == 0
    assert valve.step(settings, start, 10.0, slip_s + 1e-9).stem.slips == 1


@pytest.mark.parametrize("step_s", [0.05, 0.001, 0.0007])
def test_a_command_acts_after_the_dead_time_wherever_the_steps_end(step_s: float) -> None:
    settings = plant_settings("paper", "actuator.dead_time_s = 0.0123")
    state = valve.initial_state(settings, 0)
    start_pa = state.actuator.pressure_pa
    before = valve.step(settings, state, 6.0, 0.0123 - 1e-9)
    assert before.actuator.pressure_pa == pytest.approx(start_pa, rel=1e-14)
    assert valve.step(settings, before, 6.0, 2e-9).actuator.pressure_pa == pytest.approx(GAIN_PA_PER_MA * 6.0)

    # the motion is the undelayed one, 12.3 ms late
    prompt = plant_settings("paper")
    expected = valve.step(prompt, valve.initial_state(prompt, 0), 8.0, 0.02).stem.position_m
    left_s = 0.0323
    while left_s > 1e-12:
        state = valve.step(settings, state, 8.0, min(step_s, left_s))
        left_s -= step_s
    assert state.stem.position_m == pytest.approx(expected, abs=1e-10)


def test_commands_on_their_way_arrive_in_order_and_none_is_lost() -> None:
    line = DelayLine(4.0)
    acted: list[tuple[float, float]] = []
    for index in range(10):
        line, stretches = commanded(line, 0.0025, float(5 + index), index * 0.001, 0.001)
        acted.extend(stretches)
    assert sum(seconds for _, seconds in acted) == pytest.approx(0.010)
    assert [current for current, seconds in acted if seconds > 0.0][-1] == 12.0
    held = {current: 0.0 for current, _ in acted}
    for current, seconds in acted:
        held[current] += seconds
    assert held.pop(4.0) == pytest.approx(0.0025)
    assert held.pop(12.0) == pytest.approx(0.0005)
    assert list(held.values()) == pytest.approx([0.001] * 7)
    assert line.current_ma == 12.0
    assert [current for _, current in line.pending] == [13.0, 14.0]


def test_a_repeated_command_puts_no_edge_on_the_line() -> None:
    line, _ = commanded(DelayLine(4.0), 0.01, 5.0, 0.0, 0.001)
    again, _ = commanded(line, 0.01, 5.0, 0.001, 0.001)
    assert len(again.pending) == 1


def test_an_edge_on_the_border_of_two_steps_belongs_to_the_later_one_however_it_is_rounded() -> None:
    line, now_s, acted = DelayLine(4.0), 0.0, []
    for _ in range(4):
        line, stretches = commanded(line, 0.3, 5.0, now_s, 0.1)
        now_s += 0.1  # 0.1 + 0.1 + 0.1 is above 0.3
        acted.append(stretches)
    assert [len(stretches) for stretches in acted[:3]] == [1, 1, 1]
    assert [current for current, _ in acted[3]] == [4.0, 5.0]
    assert [seconds for _, seconds in acted[3]] == pytest.approx([0.0, 0.1])
