"""Edges between sticking and sliding, and what each teaches (paper §5.1)."""

from __future__ import annotations

import pytest

from positioner.valve.state import StemState
from positioner.valve.stick_slip import edge_lessons
from positioner.valve.stiction import Direction, LearnedSample, Quantity


def stem(position_m: float, velocity_m_per_s: float, *, stuck: bool, direction: float = 1.0) -> StemState:
    return StemState(position_m, velocity_m_per_s, stuck, direction)


@pytest.mark.parametrize(("speed", "direction"), [(0.02, Direction.OPENING), (-0.02, Direction.CLOSING)])
def test_a_stop_teaches_the_speed_before_it_at_the_place_of_rest(speed: float, direction: Direction) -> None:
    taught = edge_lessons(stem(0.079, speed, stuck=False), stem(0.080, 0.0, stuck=True), 12.0)
    assert taught == (LearnedSample(Quantity.STICK_SPEED, 0.080, direction, 0.02),)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_stem_that_never_got_a_speed_teaches_none(sign: float) -> None:
    assert edge_lessons(stem(0.08, 0.0, stuck=False), stem(0.08, 0.0, stuck=True, direction=sign), 12.0) == ()


@pytest.mark.parametrize(("sign", "direction"), [(1.0, Direction.OPENING), (-1.0, Direction.CLOSING)])
def test_a_slip_teaches_the_current_that_caused_it_at_the_place_of_rest(sign: float, direction: Direction) -> None:
    before = stem(0.080, 0.0, stuck=True, direction=-sign)
    after = stem(0.081, sign * 0.1, stuck=False, direction=sign)
    assert edge_lessons(before, after, 17.5) == (LearnedSample(Quantity.BREAKAWAY_CURRENT, 0.080, direction, 17.5),)


@pytest.mark.parametrize("stuck", [True, False])
def test_nothing_is_learned_between_edges(stuck: bool) -> None:
    assert edge_lessons(stem(0.08, 0.0, stuck=stuck), stem(0.08, 0.0, stuck=stuck), 12.0) == ()
