"""The stiction table: last ten samples by place and direction, means, spreads and ages (paper §5.1, Table 2; D9)."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from positioner.valve.stiction import Cell, CellKey, Direction, Quantity, StictionTable, direction_of

SPEED, GAMMA = Quantity.STICK_SPEED, Quantity.BREAKAWAY_CURRENT
OPENING, CLOSING = Direction.OPENING, Direction.CLOSING


def test_the_mean_of_the_papers_example_is_its_average_speed() -> None:
    # Table 2, 5 cm: 0.05, 0.04, 0.03 give 0.04
    table = StictionTable()
    for value in (0.05, 0.04, 0.03):
        table = table.record(SPEED, 0.05, OPENING, value)
    cell = table.cell(SPEED, 0.05, OPENING)
    assert cell is not None
    assert cell.mean == pytest.approx(0.04)
    assert cell.spread == pytest.approx(math.sqrt(2.0 / 3.0) * 0.01)


@given(st.lists(st.floats(-100.0, 100.0), min_size=1, max_size=40))
def test_a_cell_keeps_the_last_ten_and_counts_them_all(values: list[float]) -> None:
    table, kept = StictionTable(), deque[float](maxlen=10)
    for value in values:
        table = table.record(GAMMA, 0.08, CLOSING, value)
        kept.append(value)
    cell = table.cell(GAMMA, 0.08, CLOSING)
    assert cell == Cell(tuple(kept), len(values), len(values))
    assert cell.mean == pytest.approx(float(np.mean(kept)), abs=1e-12)
    assert cell.spread == pytest.approx(float(np.std(kept)), abs=1e-9)


@given(st.floats(-0.1, 1.3), st.sampled_from([0.001, 0.005, 0.0127]))
def test_a_position_belongs_to_the_nearest_bin(position_m: float, width_m: float) -> None:
    table = StictionTable(cell_width_m=width_m)
    assert abs(table.index_of(position_m) * width_m - position_m) <= width_m / 2 * (1 + 1e-9)


def test_quantity_place_and_direction_keep_their_samples_apart() -> None:
    table = StictionTable().record(SPEED, 0.08, OPENING, 0.3)
    assert table.cell(SPEED, 0.0824, OPENING) is not None
    assert table.cell(SPEED, 0.0826, OPENING) is None
    assert table.cell(SPEED, 0.08, CLOSING) is None
    assert table.cell(GAMMA, 0.08, OPENING) is None


def test_an_age_counts_learned_samples() -> None:
    table = StictionTable().record(SPEED, 0.08, OPENING, 0.3).record(SPEED, 0.07, OPENING, 0.4)
    table = table.record(GAMMA, 0.07, CLOSING, 6.0)
    old, young = table.cell(SPEED, 0.08, OPENING), table.cell(GAMMA, 0.07, CLOSING)
    assert old is not None
    assert young is not None
    assert (table.age(old), table.age(young)) == (2, 0)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_is_not_learned(bad: float) -> None:
    table = StictionTable().record(SPEED, 0.08, OPENING, 0.3)
    assert table.record(SPEED, 0.08, OPENING, bad) is table
    assert table.record(SPEED, bad, OPENING, 0.3) is table


@pytest.mark.interpreted
def test_a_table_never_changes() -> None:
    empty = StictionTable()
    full = empty.record(SPEED, 0.08, OPENING, 0.3)
    assert (len(empty), empty.sequence, len(full), full.sequence) == (0, 0, 1, 1)
    with pytest.raises(FrozenInstanceError):
        full.sequence = 5  # type: ignore[misc]
    with pytest.raises(TypeError):
        full.cells[CellKey(SPEED, 1, OPENING)] = Cell((1.0,), 1, 1)  # type: ignore[index]


def test_cells_are_told_in_order() -> None:
    table = StictionTable()
    for quantity, position_m, direction in ((SPEED, 0.09, OPENING), (SPEED, 0.07, OPENING), (GAMMA, 0.08, CLOSING)):
        table = table.record(quantity, position_m, direction, 1.0)
    assert [(key.quantity, key.index) for key, _ in table] == [(GAMMA, 16), (SPEED, 14), (SPEED, 18)]


@pytest.mark.parametrize(("value", "expected"), [(0.1, OPENING), (0.0, OPENING), (-0.1, CLOSING)])
def test_a_direction_is_that_of_the_sign(value: float, expected: Direction) -> None:
    assert direction_of(value) is expected
    assert expected.sign == (1.0 if value >= 0.0 else -1.0)


@pytest.mark.parametrize("quantity", Quantity)
def test_what_no_valve_can_teach_is_not_learned(quantity: Quantity) -> None:
    low, high = quantity.limits
    table = StictionTable()
    for value in (low - 1e-9, high + 1e-9, 1e308, -1e308):
        assert table.record(quantity, 0.05, Direction.OPENING, value) is table
    assert table.record(quantity, 10.1, Direction.OPENING, high) is table
    for value in (low, high):
        assert len(table.record(quantity, 0.05, Direction.OPENING, value)) == 1
