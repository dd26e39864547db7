"""Characteristics: closed forms, exact ends, rising, inverse; split range and direction of action."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from positioner.setpoint.characteristic import signal_of, travel_of
from positioner.setpoint.settings import Action, Characteristic, SetpointSettings

POINTS = ((0.0, 0.0), (0.3, 0.1), (0.6, 0.5), (1.0, 1.0))
SHAPES = [
    SetpointSettings(),
    SetpointSettings(characteristic=Characteristic.EQUAL_PERCENTAGE),
    SetpointSettings(characteristic=Characteristic.EQUAL_PERCENTAGE, rangeability=25.0),
    SetpointSettings(characteristic=Characteristic.INVERSE_EQUAL_PERCENTAGE, rangeability=33.0),
    SetpointSettings(characteristic=Characteristic.QUICK_OPENING),
    SetpointSettings(characteristic=Characteristic.POINTS, points=POINTS),
]
parts = st.floats(0.0, 1.0)


def test_the_closed_forms() -> None:
    _, equal, _, inverse, quick, own = SHAPES
    assert travel_of(equal, 0.5) == pytest.approx((math.sqrt(50.0) - 1.0) / 49.0)
    slope = (travel_of(equal, 1.0) - travel_of(equal, 1.0 - 1e-6)) / 1e-6
    assert slope == pytest.approx(math.log(50.0) * 50.0 / 49.0, rel=1e-4)
    assert travel_of(inverse, 0.7) == pytest.approx(1.0 - (33.0**0.3 - 1.0) / 32.0)
    assert travel_of(quick, 0.25) == 0.5
    assert [travel_of(own, w) for w in (0.15, 0.3, 0.45, 0.8)] == pytest.approx([0.05, 0.1, 0.3, 0.75])


@given(w=parts)
def test_the_same_step_of_an_equal_percentage_multiplies_the_travel_above_its_anchor(w: float) -> None:
    equal, w = SHAPES[1], 0.9 * w
    anchor = 1.0 / 49.0
    ratio = (travel_of(equal, w + 0.1) + anchor) / (travel_of(equal, w) + anchor)
    assert ratio == pytest.approx(50.0**0.1)


@pytest.mark.parametrize("settings", SHAPES)
@pytest.mark.parametrize("action", Action)
def test_both_ends_are_exact_and_a_signal_beyond_them_is_one_of_them(
    settings: SetpointSettings, action: Action
) -> None:
    shaped = SetpointSettings(
        characteristic=settings.characteristic,
        points=settings.points,
        rangeability=settings.rangeability,
        action=action,
        signal_low=0.5,
    )
    ends = [travel_of(shaped, signal) for signal in (-0.2, 0.5, 1.0, 1.3)]
    assert ends == ([0.0, 0.0, 1.0, 1.0] if action is Action.DIRECT else [1.0, 1.0, 0.0, 0.0])


@pytest.mark.parametrize("settings", SHAPES)
@given(first=parts, second=parts)
def test_travel_rises_with_the_signal(settings: SetpointSettings, first: float, second: float) -> None:
    low, high = sorted((first, second))
    assert travel_of(settings, low) <= travel_of(settings, high)
    if high - low > 1e-6 and settings.characteristic is not Characteristic.INVERSE_EQUAL_PERCENTAGE:
        assert travel_of(settings, low) < travel_of(settings, high)


@pytest.mark.parametrize("settings", SHAPES)
@given(w=parts, low=st.floats(0.0, 0.5), reverse=st.booleans())
def test_the_signal_comes_back_from_its_travel(settings: SetpointSettings, w: float, low: float, reverse: bool) -> None:
    action = Action.REVERSE if reverse else Action.DIRECT
    shaped = SetpointSettings(
        characteristic=settings.characteristic,
        points=settings.points,
        rangeability=settings.rangeability,
        action=action,
        signal_low=low,
        signal_high=low + 0.4,
    )
    signal = low + 0.4 * w
    assert signal_of(shaped, travel_of(shaped, signal)) == pytest.approx(signal, abs=1e-9)


def test_split_range_gives_each_of_two_valves_its_half() -> None:
    first, second = SetpointSettings(signal_high=0.5), SetpointSettings(signal_low=0.5)
    signals = (0.0, 0.25, 0.5, 0.75, 1.0)
    assert [travel_of(first, signal) for signal in signals] == [0.0, 0.5, 1.0, 1.0, 1.0]
    assert [travel_of(second, signal) for signal in signals] == [0.0, 0.0, 0.0, 0.5, 1.0]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"signal_low": 0.4, "signal_high": 0.6}, "signal_high must exceed signal_low by 0.25"),
        ({"travel_low": 0.6, "travel_high": 0.5}, "travel_low must be below travel_high"),
        ({"points": POINTS}, 'points belong to characteristic = "points"'),
        ({"characteristic": Characteristic.POINTS}, 'points belong to characteristic = "points"'),
        ({"characteristic": Characteristic.POINTS, "points": POINTS[:-1]}, "points must be 2 to 21"),
        (
            {"characteristic": Characteristic.POINTS, "points": ((0.0, 0.0), (0.5, 0.6), (0.5, 0.7), (1.0, 1.0))},
            "both numbers must rise",
        ),
    ],
)
def test_a_combination_that_cannot_be_is_refused(changes: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        SetpointSettings(**changes)  # type: ignore[arg-type]
