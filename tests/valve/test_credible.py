"""What physics excludes is neither learned nor believed, whoever taught it."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st
from loop_helpers import Loop

from plant_emulator.presets import preset_names, root_preset
from positioner.cycle.events import Learned
from positioner.cycle.trust_events import NotBelieved
from positioner.laws.registry import LAWS
from positioner.valve.credible import Limits, credible_part
from positioner.valve.parameters import ValveParameters
from positioner.valve.stiction import Cell, CellKey, Direction, LearnedSample, Quantity, StictionTable

if TYPE_CHECKING:
    from positioner.wire.messages import CanFrame

VALVE = ValveParameters(id="paper", bench_set_n=300.0)
LIMITS = Limits(VALVE)
WIDTH_M = 0.005
BIAS, GAMMA, SPEED = Quantity.LANDING_BIAS, Quantity.BREAKAWAY_CURRENT, Quantity.STICK_SPEED
ABSURD = (math.nan, math.inf, -math.inf, 1e308, -1e308)


@given(
    st.floats(VALVE.travel_min_m, VALVE.travel_max_m),
    st.sampled_from(Direction),
    st.floats(0.6, 1.5),
    st.floats(0.6, 1.5),
    st.floats(1.0, 2.0),
)
def test_whatever_the_filter_can_believe_of_a_valve_is_credible(
    x: float, direction: Direction, spring: float, friction: float, ratio: float
) -> None:
    static_n = ratio * friction * VALVE.coulomb_friction_n
    force_n = spring * VALVE.spring_rate_n_per_m * x + VALVE.bench_set_n + direction.sign * static_n
    gamma_ma = force_n / VALVE.force_gain_n_per_ma
    index = StictionTable(WIDTH_M).index_of(x)
    assert LIMITS.allows(LearnedSample(GAMMA, index * WIDTH_M, direction, gamma_ma), WIDTH_M / 2.0)
    # and nothing that is beyond any of them by an eighth of the force of full travel
    beyond_ma = 0.125 * (VALVE.spring_rate_n_per_m * VALVE.travel_max_m) / VALVE.force_gain_n_per_ma
    low, high = LIMITS.range_of(GAMMA, x, direction)
    forces_n = [
        share * VALVE.spring_rate_n_per_m * x + VALVE.bench_set_n + direction.sign * by
        for share in (0.6, 1.5)
        for by in (0.6 * VALVE.coulomb_friction_n, 3.0 * VALVE.coulomb_friction_n)
    ]
    assert low > min(forces_n) / VALVE.force_gain_n_per_ma - beyond_ma
    assert high < max(forces_n) / VALVE.force_gain_n_per_ma + beyond_ma


@given(
    st.floats(VALVE.travel_min_m, VALVE.travel_max_m),
    st.sampled_from(Direction),
    st.floats(0.6, 1.5),
    st.floats(0.6, 1.5),
)
def test_where_a_valve_stops_that_the_law_can_believe_is_credible(
    x: float, direction: Direction, spring: float, friction: float
) -> None:
    rate, sliding_n = VALVE.spring_rate_n_per_m, VALVE.coulomb_friction_n
    pressure_n = spring * (rate * x + VALVE.bench_set_n) + direction.sign * friction * sliding_n
    bias_m = x - (pressure_n - VALVE.bench_set_n - direction.sign * sliding_n) / rate
    index = StictionTable(WIDTH_M).index_of(x)
    assert LIMITS.allows(LearnedSample(BIAS, index * WIDTH_M, direction, bias_m), WIDTH_M / 2.0)


def test_a_landing_beyond_all_credible_valves_is_not_credible() -> None:
    # at 80 mm: half of (52538 N/m 80 mm + 300 N), half of 1423 N of friction, and a rise of 1.5 (1707.7 - 1423) N
    low, high = LIMITS.range_of(BIAS, 0.08, Direction.OPENING)
    spring_n = 52538.0 * 0.08 + 300.0
    assert low == pytest.approx(-(0.5 * spring_n + 0.5 * 1423.0 + 1.5 * 284.7) / 52538.0, rel=1e-4)
    assert high == pytest.approx((0.4 * spring_n + 0.4 * 1423.0 + 1.5 * 284.7) / 52538.0, rel=1e-4)
    free = Limits(ValveParameters(id="free", static_friction_n=0.0, coulomb_friction_n=0.0), least=1.0, most=1.0)
    assert free.range_of(BIAS, 0.08, Direction.OPENING) == pytest.approx((-0.01 * VALVE.span_m, 0.01 * VALVE.span_m))
    assert not LIMITS.allows(LearnedSample(BIAS, 0.08, Direction.OPENING, -69.9e-3))
    assert LIMITS.allows(LearnedSample(BIAS, 0.08, Direction.OPENING, -13e-3))


def test_a_stem_is_no_faster_than_the_loop_can_make_it() -> None:
    # 20.5 mA · 333.6 N/mA against 0.6 · 612.9 N s/m would be 18.6 m/s; closing, 1.5 springs push the harder
    _, fastest = LIMITS.range_of(SPEED, 0.08, Direction.OPENING)
    assert 20.0 < fastest < 30.0
    light = Limits(ValveParameters(id="light", viscous_friction_n_s_per_m=0.1))
    _, undamped = light.range_of(SPEED, 0.08, Direction.OPENING)
    closing_n = 1.5 * 52538.0 * 0.1397 - 333.6 * 3.8
    assert undamped == pytest.approx(math.sqrt(2.0 * closing_n * 0.1397 / 1.361), rel=1e-3)


@pytest.mark.parametrize("quantity", Quantity)
@pytest.mark.parametrize("value", ABSURD)
@pytest.mark.parametrize("direction", Direction)
def test_absurd_values_are_not_credible_anywhere(quantity: Quantity, value: float, direction: Direction) -> None:
    for x in (-1e308, -1.0, 0.0, 0.08, 0.1397, 5.0, 1e308, math.nan):
        assert not LIMITS.allows(LearnedSample(quantity, x, direction, value))


@pytest.mark.parametrize("x", [-0.01, 0.15, 1.0])
def test_nothing_is_credible_beyond_the_travel(x: float) -> None:
    for quantity in Quantity:
        assert not LIMITS.allows(LearnedSample(quantity, x, Direction.OPENING, 1e-3))


def test_a_table_keeps_what_is_credible_of_it() -> None:
    good = StictionTable(WIDTH_M)
    for value in (1e-4, 2e-4, 3e-4):
        good = good.record(BIAS, 0.08, Direction.OPENING, value)
    assert credible_part(LIMITS, good)[0] is good
    mixed = good.record(BIAS, 0.08, Direction.OPENING, 0.09).record(GAMMA, 0.075, Direction.CLOSING, 99.0)
    table, excluded = credible_part(LIMITS, mixed)
    assert [(each.quantity, each.value) for each in excluded] == [(GAMMA, 99.0), (BIAS, 0.09)]
    assert dict(table.cells) == {CellKey(BIAS, 16, Direction.OPENING): Cell((1e-4, 2e-4, 3e-4), 3, 4)}
    assert table.sequence == mixed.sequence


def poisoned(value: float) -> StictionTable:
    """A table that says the same absurd thing of every quantity, everywhere, often enough to be believed."""
    keys = [
        CellKey(quantity, index, direction)
        for index in range(round(VALVE.travel_max_m / WIDTH_M) + 1)
        for quantity in Quantity
        for direction in Direction
    ]
    # no table would record it: this one has come from elsewhere
    cells = {key: Cell((value,) * 4, 4, len(keys)) for key in keys}
    return StictionTable(WIDTH_M, 4 * len(keys), MappingProxyType(cells))


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("value", [-69.9, 1e308])
def test_a_law_with_an_absurd_table_does_as_with_none_and_says_so_once(law: str, value: float) -> None:
    table = poisoned(value)
    fresh, given = Loop(law), Loop(law, table)
    for loop in (fresh, given):
        loop.run(0.05, 0.08)
    assert given.position_m == fresh.position_m
    (event,) = (event for event in given.events_of(NotBelieved) if not event.taught)
    assert event.count == 4 * len(table)
    assert str(event).startswith("not used from the table: ")
    assert not any(not event.taught for event in fresh.events_of(NotBelieved))
    # one more that comes while it runs, as an import does
    given.state = replace(given.state, table=table)
    given.run(0.002, 0.08)
    assert sum(not event.taught for event in given.events_of(NotBelieved)) == 2


@pytest.mark.parametrize(("late", "most_m"), [(1, 2e-3), (2, 4e-3), (3, 2e-3), (5, 2e-3)])
def test_a_push_that_acts_late_teaches_no_landing_that_never_was(late: int, most_m: float) -> None:
    loop, waiting = Loop("nmpc"), deque[tuple["CanFrame", ...]]([()] * late)

    def delay(frames: tuple[CanFrame, ...]) -> tuple[CanFrame, ...]:
        waiting.append(frames)
        return waiting.popleft()

    loop.to_plant = delay
    for setpoint_m in (0.08, 0.073, 0.087, 0.08, 0.073, 0.087):
        loop.run(0.2, setpoint_m)
    biases_m = [event.sample.value for event in loop.events_of(Learned) if event.sample.quantity is BIAS]
    assert all(abs(bias_m) < most_m for bias_m in biases_m), biases_m


def test_what_physics_excludes_is_not_learned_but_reported() -> None:
    # the first push of the paper's law is the whole loop: 20 mA at 10 mm frees the stem, and is no breakaway current
    loop = Loop("paper")
    loop.run(0.1, 0.08)
    (event,) = loop.events_of(NotBelieved)
    assert event.taught
    assert event.sample.value == 20.0
    assert "not learned: breakaway_current_ma = 20" in str(event)
    assert all(value < 16.0 for key, cell in loop.state.table if key.index == 2 for value in cell.samples)


@pytest.mark.parametrize("preset", sorted(name for name in preset_names() if root_preset(name) != "graphite"))
def test_what_the_emulated_valves_do_is_credible(preset: str) -> None:
    # the law believes in the nominal valve, of which all but those of graphite are variants
    loop = Loop("nmpc", plant={"preset": preset})
    for setpoint_m in (0.073, 0.087, 0.08):
        loop.run(0.2, setpoint_m)
    assert loop.events_of(NotBelieved) == []
