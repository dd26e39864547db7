"""The points of a campaign: strata, balance, completeness, and the values at the places of a range."""

from __future__ import annotations

import math
from itertools import combinations, product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from positioner.campaign.design import Parameter, points, size, unit_points
from positioner.campaign.schema import DesignSettings, Kind, RangeSettings, Scale

LINEAR = Parameter("a", RangeSettings(low=-2.0, high=6.0, levels=5), (("a", None),))
LOGARITHMIC = Parameter("b", RangeSettings(low=0.01, high=100.0, scale=Scale.LOGARITHMIC, levels=3), (("b", None),))
LISTED = Parameter("c", RangeSettings(values=("x", "y", "z")), (("c", None),))
WHOLE = Parameter("d", RangeSettings(low=2.0, high=5.0, levels=4), (("d", None),), whole=True)
ALL = (LINEAR, LOGARITHMIC, LISTED, WHOLE)


@pytest.mark.parametrize("count", [1, 7, 30])
def test_each_of_equal_parts_of_every_range_has_one_point_of_a_latin_hypercube(count: int) -> None:
    found = unit_points(DesignSettings(kind=Kind.LATIN_HYPERCUBE, points=count), 5)
    for dimension in range(5):
        assert sorted(np.floor(found[:, dimension] * count)) == list(range(count))


@pytest.mark.parametrize("seed", [1, 2])
def test_a_sobol_sequence_is_even_in_every_projection(seed: int) -> None:
    found = unit_points(DesignSettings(kind=Kind.SOBOL, points=64, seed=seed), 4)
    for dimension in range(4):  # one in each of 64 parts, and so 32 in each half, 16 in each quarter ...
        assert sorted(np.floor(found[:, dimension] * 64)) == list(range(64))
    for one, other in combinations(range(4), 2):  # a (t, 6, 2)-net with t at most 2: 4 in each of 4 × 4 parts
        cells = np.floor(found[:, (one, other)] * 4)
        assert all(np.sum(np.all(cells == cell, axis=1)) == 4 for cell in product(range(4), repeat=2))


def test_a_longer_sobol_sequence_begins_with_the_shorter_one() -> None:
    short, long = (unit_points(DesignSettings(kind=Kind.SOBOL, points=count), 3) for count in (16, 64))
    np.testing.assert_array_equal(long[:16], short)


def test_a_grid_is_every_combination_of_its_levels_once() -> None:
    grid = DesignSettings(kind=Kind.GRID)
    found = points(grid, ALL)
    assert len(found) == size(grid, ALL) == 5 * 3 * 3 * 4
    levels = ((-2.0, 0.0, 2.0, 4.0, 6.0), (0.01, 1.0, 100.0), ("x", "y", "z"), (2, 3, 4, 5))
    assert [tuple(f"{value:.6g}" if isinstance(value, float) else value for value in point) for point in found] == [
        tuple(f"{value:.6g}" if isinstance(value, float) else value for value in point) for point in product(*levels)
    ]


@pytest.mark.parametrize("kind", [Kind.SOBOL, Kind.LATIN_HYPERCUBE])
def test_the_same_seed_gives_the_same_points_and_another_one_others(kind: Kind) -> None:
    designs = [DesignSettings(kind=kind, points=16, seed=seed) for seed in (1, 1, 2)]
    first, second, third = (points(design, ALL) for design in designs)
    assert first == second != third
    assert size(designs[0], ALL) == len(first) == 16


@pytest.mark.parametrize("kind", [Kind.SOBOL, Kind.LATIN_HYPERCUBE])
def test_a_list_and_whole_numbers_are_as_even_as_a_range(kind: Kind) -> None:
    found = points(DesignSettings(kind=kind, points=256), (LISTED, WHOLE))
    names, numbers = zip(*found, strict=True)
    for values, count in ((names, 3), (numbers, 4)):
        assert len(set(values)) == count
        for value in set(values):
            assert abs(values.count(value) - 256 / count) <= 1.0
    assert all(type(number) is int for number in numbers)


def test_a_logarithmic_range_is_divided_by_factors() -> None:
    assert LOGARITHMIC.value_at(0.5) == pytest.approx(1.0)
    assert LOGARITHMIC.value_at(0.75) == pytest.approx(10.0)
    assert LINEAR.value_at(0.75) == pytest.approx(4.0)


@given(place=st.floats(0.0, 1.0))
def test_every_place_has_a_value_of_the_range_and_a_range_its_ends(place: float) -> None:
    for parameter in (LINEAR, LOGARITHMIC, WHOLE):
        low, high = parameter.ends
        assert (parameter.value_at(0.0), parameter.value_at(1.0)) == (low, high)
        assert low <= float(parameter.value_at(place)) <= high
    for parameter in (LINEAR, LOGARITHMIC):
        assert parameter.place_of(parameter.value_at(place)) == pytest.approx(place, abs=1e-9)
    assert abs(LISTED.place_of(LISTED.value_at(place)) - place) <= 1.0 / 6.0 + 1e-9
    assert math.isclose(WHOLE.place_of(3), 1.0 / 3.0)
