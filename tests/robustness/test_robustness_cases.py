"""The cases of the robustness test: drawn evenly, by class, from the declared space, and possible."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from plant_emulator.presets import plant_settings
from positioner.bench.configure import told
from positioner.bench.playable import restartable_mm
from positioner.config.reader import parse_config
from positioner.robustness.cases import (
    AS_CONFIGURED,
    BEYOND,
    CLASSES,
    NOT_CONFIGURED,
    WITHIN,
    WRONGLY,
    Case,
    base_of,
    drawn,
)
from positioner.robustness.play import OPTIMAL, Run, play, scenario_of
from positioner.robustness.sets import SETS
from positioner.robustness.space import packaged_space

SPACE = packaged_space()
DRAWN = {group: drawn(SPACE, group, 64, 1) for group in CLASSES}


def told_to(tables: dict[str, Any]) -> dict[str, Any]:
    settings = plant_settings(overrides=tables)
    return told(settings) | {"noise": settings.sensor.noise_of_reading}


@pytest.mark.parametrize("group", CLASSES)
def test_the_same_seed_draws_the_same_valves_and_a_longer_study_begins_with_a_shorter_one(group: str) -> None:
    assert drawn(SPACE, group, 16, 1) == DRAWN[group][:16]
    assert drawn(SPACE, group, 16, 2) != DRAWN[group][:16]


@pytest.mark.parametrize("group", [AS_CONFIGURED, BEYOND])
def test_a_positioner_that_is_configured_right_is_told_all_that_it_has_a_key_for(group: str) -> None:
    for case in DRAWN[group]:
        assert told_to(case.told) == told_to(case.true)
        assert case.true["stochastic"]["friction_fraction"] == case.true["process"]["sine_n"] == 0.0


def test_within_20_percent_every_parameter_is_off_by_so_much_at_most_and_most_are() -> None:
    ratios = []
    for case in DRAWN[WITHIN]:
        true, wrong = told_to(case.true), told_to(case.told)
        names = ("spring_rate_n_per_m", "diaphragm_area_m2", "static_friction_n", "noise")
        ratios += [wrong[name] / true[name] for name in names]
        assert wrong["coulomb_friction_n"] <= wrong["static_friction_n"]
    assert 0.8 <= min(ratios) < 0.82
    assert 1.18 < max(ratios) <= 1.2
    # of an even distribution from 0.8 to 1.2 the mean is 1 and the standard deviation 0.4/√12
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.02)
    assert np.std(ratios) == pytest.approx(0.4 / 12.0**0.5, rel=0.08)


def test_where_one_or_two_parameters_are_wrong_all_others_are_right() -> None:
    names = set()
    for case in DRAWN[WRONGLY]:
        true, wrong = told_to(case.true), told_to(case.told)
        differ = {name for name in true if true[name] != wrong[name]} - {"coulomb_friction_n"}
        marks = [name for name in case.factors if "configured" in name]
        assert 1 <= len(marks) <= 2
        assert len(differ) <= 3
        names |= set(marks)
    assert len(names) > 12  # nearly all of 19 mistakes in 64 valves


def test_what_is_not_configured_is_there_and_the_positioner_knows_nothing_of_it() -> None:
    effects = set()
    for case in DRAWN[NOT_CONFIGURED]:
        marks = [name for name in case.factors if name.endswith(", not configured")]
        assert 1 <= len(marks) <= 2
        assert case.true != case.told or case.force_step_n > 0.0
        effects |= set(marks)
    assert len(effects) == 20  # 6 that a configuration has keys for, and 14 others


@pytest.mark.parametrize("group", CLASSES[:-1])
def test_every_setpoint_is_in_reach_of_the_true_valve_and_every_step_in_the_declared_range(group: str) -> None:
    small = steps = 0
    for case in DRAWN[group]:
        settings = plant_settings(overrides=case.true)
        low_mm, high_mm = restartable_mm(settings)
        assert low_mm < min(case.setpoints_mm) <= max(case.setpoints_mm) < high_mm
        places_mm = (settings.valve.initial_position_m * 1e3, *case.setpoints_mm)
        parts = [abs(after - before) / 127.0 for before, after in pairwise(places_mm)]
        assert all(0.00199 < part < 0.601 for part in parts)
        small += sum(part < 0.03 for part in parts)
        steps += len(parts)
    # 40 % are drawn small; large ones that do not fit the reach are drawn again, so small ones are a few more
    assert 0.38 < small / steps < 0.55


def test_every_second_setpoint_beyond_reach_lies_outside_it_and_inside_the_travel() -> None:
    outside = 0
    for case in DRAWN[BEYOND]:
        settings = plant_settings(overrides=case.true)
        low_mm, high_mm = restartable_mm(settings)
        outside += sum(not low_mm <= each <= high_mm for each in case.setpoints_mm[1::2])
        assert all(low_mm <= each <= high_mm for each in case.setpoints_mm[::2])
        assert all(0.0 < each < 139.7 for each in case.setpoints_mm)
    assert outside > 0.9 * 5 * len(DRAWN[BEYOND])


def test_every_factor_of_the_space_fills_its_range() -> None:
    valves = [case for group in CLASSES[:-1] for case in DRAWN[group]]
    for name, factor in {**SPACE.valve, **SPACE.configurable}.items():
        if name == "friction":  # made smaller where it leaves no reach
            continue
        values = [case.factors[name] for case in valves if name in case.factors]
        low, high = factor.at(0.1), factor.at(0.9)
        assert min(values) < low
        assert max(values) > high
        share = sum(low < value < high for value in values) / len(values)
        assert share == pytest.approx(0.8, abs=0.16)  # twice the standard deviation of 38 independent draws is 0.13


def test_around_a_configuration_the_positioner_is_always_told_what_it_says() -> None:
    text = """
[valve]
id = "mine"
preset = "paper"
span_m = 0.05
travel_max_m = 0.055
spring_rate_n_per_m = 90000.0
static_friction_n = 700.0
coulomb_friction_n = 600.0
[valve.actuator]
fill_time_constant_s = 0.03
vent_time_constant_s = 0.04
[bus]
[control]
sample_period_s = 0.004
"""
    base = base_of(parse_config(text, "mine.toml", Path()))
    for group in CLASSES[:-1]:
        for case in drawn(SPACE, group, 16, 1, base):
            own = told_to(case.told)
            assert own["spring_rate_n_per_m"] == pytest.approx(90000.0)
            assert own["static_friction_n"] == pytest.approx(700.0)
            assert own["span_m"] == 0.05
            assert own["actuator"]["vent_time_constant_s"] == pytest.approx(0.04)
            assert case.period_s == 0.004
            if group == AS_CONFIGURED:
                assert case.true == case.told
            elif group == WITHIN:
                true = told_to(case.true)
                assert 1.0 / 1.2 <= true["spring_rate_n_per_m"] / 90000.0 <= 1.0 / 0.8
                assert true["spring_rate_n_per_m"] != 90000.0


def test_no_force_steps_at_the_end_of_a_dwell() -> None:
    case = next(one for one in SETS["forces"](SPACE, 1) if one.force_step_n)
    scenario = scenario_of(Run(case, "nmpc"))
    changes = scenario.plant["schedule"]
    assert len(changes) == len(case.setpoints_mm)
    for number, change in enumerate(changes):
        into_s = change["at_s"] - number * scenario.dwell_s
        assert 0.0 <= into_s <= scenario.dwell_s - 1.0
    assert {abs(change["value"]) for change in changes} == {case.force_step_n}


def test_the_sets_name_every_case_once_and_conditions_are_single_mismatches_at_1_khz() -> None:
    for name, cases_of in SETS.items():
        cases = list(cases_of(SPACE, 2))
        assert len({case.label for case in cases}) == len(cases)
        assert {case.group for case in cases} == {name}
    kinds = {case.name.partition(" #")[0] for case in SETS["conditions"](SPACE, 1)}
    assert len(kinds) == 66
    assert {case.period_s for case in SETS["conditions"](SPACE, 1)} == {0.001}


def quick(case: Case) -> Case:
    from dataclasses import replace  # noqa: PLC0415

    return replace(case, setpoints_mm=case.setpoints_mm[:2], period_s=0.005)


def test_a_run_depends_on_its_case_alone() -> None:
    case = quick(DRAWN[AS_CONFIGURED][1])
    once, again = play(Run(case, "pi")), play(Run(case, "pi"))
    assert once == again
    assert once.failure is None
    assert len(once.dwells) == 2
    assert Run(case, "pi").key != Run(case, "nmpc").key != Run(case, "nmpc", informed=True).key


def test_a_time_optimal_move_takes_longer_behind_a_lag() -> None:
    cases = {case.name: case for case in SETS["lags"](SPACE, 1)}
    quick_s = play(Run(cases["0.5 ms, not configured #0"], OPTIMAL)).optimal_s
    slow_s = play(Run(cases["100 ms, not configured #0"], OPTIMAL)).optimal_s
    assert len(quick_s) == len(slow_s) == SPACE.dwells
    assert all(slow > 1.5 * quick for quick, slow in zip(quick_s, slow_s, strict=True))
    assert all(0.001 <= each < 0.05 for each in quick_s)


def test_the_rates_of_their_set_are_those_of_the_guard_and_no_other_case_has_one() -> None:
    limits = {case.name: scenario_of(Run(case, "nmpc")).guard for case in SETS["rates"](SPACE, 1)}
    assert len(limits) == 12
    for name, guard in limits.items():
        assert guard == {"max_rate_ma_per_s": float(name.partition(" mA/s")[0])}
        assert guard["max_rate_ma_per_s"] > 0.0
    assert all(not scenario_of(Run(case, "nmpc")).guard for case in SETS["lags"](SPACE, 1))


def test_physics_plays_every_preset_that_does_not_move_as_the_laws_believe() -> None:
    cases = list(SETS["physics"](SPACE, 1))
    assert {case.true["preset"] for case in cases} == {
        "lugre", "lugre-graphite", "mass-flow", "mass-flow-booster", "mass-flow-lugre", "maxwell-slip",
    }  # fmt: skip
    for case in cases:
        believed, true = plant_settings(overrides=case.told), plant_settings(overrides=case.true)
        assert (believed.friction.model, believed.actuator.model) == ("karnopp", "lag")
        assert believed.valve.static_friction_n == true.valve.static_friction_n


def test_a_case_of_other_physics_is_played_and_measured_by_karnopps_time_optimal_move() -> None:
    cases = {case.name: case for case in SETS["physics"](SPACE, 1)}
    case = quick(cases["lugre, lag 0 ms #0"])
    played = play(Run(case, "pi"))
    assert played.failure is None
    assert all(dwell.error_pct < 5.0 for dwell in played.dwells)
    assert all(0.001 <= each < 0.1 for each in play(Run(case, OPTIMAL)).optimal_s)
    slow = play(Run(quick(cases["mass-flow #0"]), OPTIMAL)).optimal_s
    assert all(0.05 < each < 20.0 for each in slow)


def test_a_run_that_cannot_be_played_says_why() -> None:
    case = quick(DRAWN[AS_CONFIGURED][0])
    case.true["valve"]["mass_kg"] = 1e6
    assert "mass_kg" in (play(Run(case, "pi")).failure or "")


def test_the_page_names_every_factor_of_the_space() -> None:
    page = (Path(__file__).resolve().parents[2] / "docs" / "robustness.md").read_text(encoding="utf-8")
    for name in (*SPACE.valve, *SPACE.configurable, *SPACE.unmodelled):
        assert f"`{name}`" in page
    for group in CLASSES:
        assert f"| {group} |" in page
    for name in SETS:
        assert f"`{name}`" in page
