"""Time passes in every plant: there are few events between two instants, however fast the pressure settles."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from plant_emulator import valve
from plant_emulator.moving_stem import MovingStem
from plant_emulator.presets import plant_settings, preset_names

if TYPE_CHECKING:
    from collections.abc import Iterator

    from plant_emulator.force import PushingForce
    from plant_emulator.parameters import PlantSettings
    from plant_emulator.segment import Segment
    from plant_emulator.valve import PlantState

EVENTS_PER_S = 1e5
"""Borders of a friction field every 0.1 mm at 10 m/s; far below what fits into the tolerance of a located event."""
EVENTS = 100
"""Several at one instant are correct: a stop, a new draw of the friction, a slip, a border."""


class _NoProgressError(AssertionError):
    pass


@pytest.fixture(scope="module")
def _counted_events() -> Iterator[None]:
    """Make every `MovingStem.advance` fail that takes more events than are possible in its time."""
    advance, segment = MovingStem.advance, MovingStem._segment
    left = [0.0]

    def counting(stem: MovingStem, force: PushingForce, left_s: float) -> Segment:
        left[0] -= 1
        if left[0] < 0:
            raise _NoProgressError(f"{stem} has {left_s} s left")
        return segment(stem, force, left_s)

    def allowing(stem: MovingStem, force: PushingForce, duration_s: float) -> None:
        left[0] = EVENTS + EVENTS_PER_S * duration_s
        advance(stem, force, duration_s)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(MovingStem, "_segment", counting)
        patch.setattr(MovingStem, "advance", allowing)
        yield


lags_s = st.floats(-4.0, -2.0).map(lambda exponent: 10.0**exponent)
"""0.1 to 10 ms, each decade alike."""
commands = st.lists(
    st.tuples(st.floats(0.0, 24.0), st.floats(-4.0, -1.0).map(lambda exponent: 10.0**exponent)), min_size=1, max_size=8
)


def _plant(
    preset: str,
    fill_s: float,
    vent_s: float,
    dead_s: float,
    spring: float,
    viscous: float,
    band: float,
    converter: float | None = None,
) -> PlantSettings:
    """Return a plant with these lags and multiples; `converter` is the lag of the I/P converter over `fill_s`."""
    base = plant_settings(preset).valve
    lags = {} if converter is None else {"converter_time_constant_s": converter * fill_s}
    return plant_settings(
        preset,
        {
            "actuator": {
                "fill_time_constant_s": fill_s,
                "vent_time_constant_s": vent_s,
                "dead_time_s": dead_s,
                **lags,
            },
            "valve": {
                "spring_rate_n_per_m": spring * base.spring_rate_n_per_m,
                "viscous_friction_n_s_per_m": viscous * base.viscous_friction_n_s_per_m,
                "stick_velocity_m_per_s": band * base.stick_velocity_m_per_s,
            },
        },
    )


def _plants(presets: tuple[str, ...], converters: tuple[float | None, ...]) -> st.SearchStrategy[PlantSettings]:
    return st.builds(
        _plant,
        st.sampled_from(presets),
        lags_s,
        lags_s,
        st.one_of(st.just(0.0), st.floats(1e-5, 0.02)),
        st.sampled_from([1.0, 0.1, 50.0]),
        st.sampled_from([1.0, 0.0, 8.0]),
        st.sampled_from([1.0, 0.01, 20.0]),
        st.sampled_from(converters),
    )


EVENTFUL = tuple(
    name
    for name in preset_names()
    if plant_settings(name).friction.model == "karnopp" and plant_settings(name).actuator.model == "lag"
)
"""Presets whose motion is computed from event to event."""
PLAIN = tuple(name for name in EVENTFUL if name not in {"pneumatics", "process", "ageing"})
"""Presets whose stem slips where the lag of the chamber alone brings the force to F_s."""


@pytest.mark.usefixtures("_counted_events")
@settings(max_examples=400)
@given(_plants(EVENTFUL, (None, 1.0, 0.3)), commands, st.integers(0, 50))
def test_time_passes_whatever_the_lags_the_dead_time_and_the_commands(
    plant: PlantSettings, sequence: list[tuple[float, float]], seed: int
) -> None:
    state = valve.initial_state(plant, seed)
    for current_ma, duration_s in sequence:
        state = valve.step(plant, state, current_ma, duration_s)
        assert math.isfinite(state.stem.position_m)


@pytest.mark.usefixtures("_counted_events")
@settings(max_examples=300)
@given(_plants(PLAIN, (None,)), st.sampled_from([(24.0, 0.0), (0.0, 24.0)]), st.floats(-9.0, -3.0), st.integers(0, 50))
@example(_plant("paper", 0.00017, 0.00087, 0.0, 1.0, 1.0, 1.0), (24.0, 0.0), -6.7, 0)  # stops while the pull falls fast
@example(_plant("graphite", 0.00068, 0.00744, 0.0, 1.0, 8.0, 1.0), (24.0, 0.0), -7.0, 0)  # creeps while it rises fast
@example(_plant("graphite", 0.0001, 0.0001, 0.0, 1.0, 1.0, 0.01), (0.0, 24.0), -6.375, 0)  # slides for nanoseconds
def test_a_push_that_is_reversed_just_after_the_slip_takes_few_events(
    plant: PlantSettings, push: tuple[float, float], exponent: float, seed: int
) -> None:
    there_ma, back_ma = push
    state = valve.initial_state(plant, seed)
    push_n = _push_n(plant, state, there_ma)
    assume(push_n > state.packing.static_n)
    slip_s = _slip_s(plant, state, push_n, filling=there_ma > back_ma)
    for current_ma, duration_s in ((there_ma, slip_s + 10.0**exponent), (back_ma, 0.05), (there_ma, 0.05)):
        state = valve.step(plant, state, current_ma, duration_s)
    assert state.stem.slips or not plant.valve.static_friction_n


def _push_n(plant: PlantSettings, state: PlantState, current_ma: float) -> float:
    """Return the difference in N between the final force of `current_ma` and the force in `state`."""
    v = plant.valve
    return abs(v.diaphragm_area_m2 * (v.pressure_gain_pa_per_ma * current_ma - state.actuator.pressure_pa))


def _slip_s(plant: PlantSettings, state: PlantState, push_n: float, *, filling: bool) -> float:
    """Return the time in s until `state`, in balance, slips under a push that grows to `push_n`, with the dead time."""
    actuator = plant.actuator
    lag_s = actuator.fill_time_constant_s if filling else actuator.vent_time_constant_s
    return actuator.dead_time_s + lag_s * math.log(push_n / (push_n - state.packing.static_n))


@pytest.mark.usefixtures("_counted_events")
@pytest.mark.parametrize("converter_s", [0.005, 0.0086701])
def test_a_stem_without_friction_starts_behind_two_lags_in_few_events(converter_s: float) -> None:
    lags = {"fill_time_constant_s": 0.0086701, "converter_time_constant_s": converter_s}
    plant = plant_settings("frictionless", {"actuator": lags})
    state = valve.step(plant, valve.initial_state(plant, 7), 21.1, 0.05)
    assert state.stem.position_m > 0.1
