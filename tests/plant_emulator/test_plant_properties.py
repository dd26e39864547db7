"""Laws for every valve and every command: no energy from nothing, no way out of the travel, no motion at rest."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hypothesis import given, settings
from hypothesis import strategies as st
from plant_cuts import whole_and_cut

from plant_emulator import valve
from plant_emulator.presets import plant_settings

if TYPE_CHECKING:
    from plant_emulator.parameters import PlantSettings
    from plant_emulator.valve import PlantState

PRESETS = ("paper", "frictionless", "spring-20", "friction+20", "stochastic", "graphite")
LAGS = (0.0, 0.001, 0.0086701, 0.1)

commands = st.lists(st.tuples(st.floats(0.0, 24.0), st.sampled_from([1e-4, 1e-3, 5e-3, 0.05])), min_size=1, max_size=12)
lagging_plants = st.builds(
    lambda preset, fill_s, vent_s, dead_s, bench_n, viscous: plant_settings(
        preset,
        {
            "actuator": {"fill_time_constant_s": fill_s, "vent_time_constant_s": vent_s, "dead_time_s": dead_s},
            "valve": {"bench_set_n": bench_n, "viscous_friction_n_s_per_m": viscous},
        },
    ),
    st.sampled_from(PRESETS),
    st.sampled_from(LAGS),
    st.sampled_from(LAGS),
    st.sampled_from([0.0, 0.0013]),
    st.sampled_from([0.0, 500.0]),
    st.sampled_from([0.0, 60.0, 534.8, 3000.0]),
)


def energy_j(plant: PlantSettings, state: PlantState) -> float:
    v = plant.valve
    return 0.5 * v.mass_kg * state.stem.velocity_m_per_s**2 + 0.5 * v.spring_rate_n_per_m * state.stem.position_m**2


@settings(max_examples=120)
@given(st.sampled_from(PRESETS), commands, st.integers(0, 50))
def test_the_stem_never_gains_more_energy_than_the_pressure_gives(
    preset: str, sequence: list[tuple[float, float]], seed: int
) -> None:
    plant = plant_settings(preset, {"actuator": {"fill_time_constant_s": 0.0, "vent_time_constant_s": 0.0}})
    state = valve.initial_state(plant, seed)
    for current, duration in sequence:
        after = valve.step(plant, state, current, duration)
        work = (
            after.actuator.pressure_pa * plant.valve.diaphragm_area_m2 * (after.stem.position_m - state.stem.position_m)
        )
        assert energy_j(plant, after) - energy_j(plant, state) <= work + 1e-8
        state = after


@settings(max_examples=150)
@given(lagging_plants, commands, st.integers(0, 50))
def test_the_stem_stays_in_its_travel_and_rests_only_without_speed(
    plant: PlantSettings, sequence: list[tuple[float, float]], seed: int
) -> None:
    state = valve.initial_state(plant, seed)
    for current, duration in sequence:
        before, state = state, valve.step(plant, state, current, duration)
        assert plant.valve.travel_min_m <= state.stem.position_m <= plant.valve.travel_max_m
        now, then = state.stem, before.stem
        # the travel is a sum over hundreds of friction cells, each rounded
        assert now.travel_m >= then.travel_m + abs(now.position_m - then.position_m) - 1e-12
        assert now.slips in (now.stops, now.stops + 1)
        if now.is_at_rest:
            assert now.velocity_m_per_s == 0.0
        if then.is_at_rest and now.is_at_rest and now.slips == then.slips and plant.valve.static_friction_n > 0.0:
            assert now.position_m == then.position_m


@settings(max_examples=60)
@given(lagging_plants, commands, st.integers(2, 40), st.integers(0, 50))
def test_no_cut_of_time_changes_the_motion(
    plant: PlantSettings, sequence: list[tuple[float, float]], pieces: int, seed: int
) -> None:
    for whole, cut in whole_and_cut(plant, seed, sequence, pieces):
        assert abs(whole.stem.position_m - cut.stem.position_m) < 1e-9
        assert (whole.stem.slips, whole.stem.stops, whole.stem.reversals) == (
            cut.stem.slips,
            cut.stem.stops,
            cut.stem.reversals,
        )
