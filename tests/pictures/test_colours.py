"""The colours: one meaning for each, legible on white, and told apart by every kind of colour vision and in grey."""

from __future__ import annotations

from itertools import combinations, pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from positioner.pictures import colours
from positioner.pictures.colours import BELIEF, BOUND, BREAKAWAY, COMMAND, MEASURED, POSITION, SETPOINT

Array = NDArray[np.float64]

SEEN_BY = {
    "everybody": np.eye(3),
    "protanopes": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    ),
    "deuteranopes": np.array(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
    ),
    "tritanopes": np.array(
        [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]]
    ),
}
"""Linear sRGB as it is seen: Machado, Oliveira and Fernandes, IEEE TVCG 15 (2009), severity 1."""
TO_XYZ = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)
WHITE = np.array([0.95047, 1.0, 1.08883])
PANELS = {
    "position": (POSITION, MEASURED, SETPOINT, BELIEF),
    "current": (COMMAND, BOUND, BREAKAWAY),
    "speed": (POSITION, BELIEF, BOUND),
    "replay": (colours.REFERENCE, COMMAND),
    "signature": (colours.OPENING, colours.CLOSING),
    "table": colours.TABLE,
}
LINES = (POSITION, MEASURED, SETPOINT, BELIEF, COMMAND, BOUND, BREAKAWAY, colours.FALLBACK, colours.TABLE[0],
         colours.PROCESS_VALUE, colours.OPENING, colours.CLOSING)  # fmt: skip


def linear(colour: str) -> Array:
    levels = np.array([int(colour[place : place + 2], 16) for place in (1, 3, 5)]) / 255.0
    return np.where(levels <= 0.04045, levels / 12.92, ((levels + 0.055) / 1.055) ** 2.4)


def lab(light: Array) -> Array:
    """Return CIE L*a*b* of linear sRGB."""
    share = TO_XYZ @ np.clip(light, 0.0, 1.0) / WHITE
    curve = np.where(share > 0.008856, np.cbrt(share), 7.787 * share + 16.0 / 116.0)
    return np.array([116.0 * curve[1] - 16.0, 500.0 * (curve[0] - curve[1]), 200.0 * (curve[1] - curve[2])])


def contrast_on_white(colour: str) -> float:
    """Return the contrast ratio of WCAG 2."""
    return float(1.05 / (TO_XYZ[1] @ linear(colour) + 0.05))


def test_no_colour_has_two_meanings() -> None:
    named = [value for name, value in vars(colours).items() if name.isupper() and isinstance(value, str)]
    several = [*colours.TABLE, *colours.MODES.values(), *colours.SERIES]
    status = [value for value in colours.STATUS.values() if value != colours.FALLBACK]
    every = [colour.upper() for colour in (*named, *several, *status)]
    assert len(every) == len(set(every)) > 30


@pytest.mark.parametrize("colour", LINES)
def test_a_line_is_legible_on_white(colour: str) -> None:
    assert contrast_on_white(colour) >= 3.0


@pytest.mark.parametrize("shade", colours.MODES.values())
def test_the_shade_of_a_mode_is_pale_enough_for_every_line_on_it(shade: str) -> None:
    assert 1.1 < contrast_on_white(shade) < 1.8
    assert min(contrast_on_white(line) / contrast_on_white(shade) for line in LINES) > 1.8


@pytest.mark.parametrize("sight", SEEN_BY)
@pytest.mark.parametrize("panel", PANELS)
def test_what_shares_a_panel_is_told_apart(panel: str, sight: str) -> None:
    seen = [lab(SEEN_BY[sight] @ linear(colour)) for colour in PANELS[panel]]
    assert min(float(np.linalg.norm(one - other)) for one, other in combinations(seen, 2)) > 13.0


@pytest.mark.parametrize("panel", ["replay", "signature", "table"])
def test_what_has_no_other_sign_differs_in_lightness(panel: str) -> None:
    lightness = sorted(float(lab(linear(colour))[0]) for colour in PANELS[panel])
    assert min(high - low for low, high in pairwise(lightness)) > 15.0


def test_laws_that_are_compared_have_a_mark_and_a_colour_each() -> None:
    assert len(set(colours.SERIES)) == len(set(colours.MARKS)) == 9
    assert min(map(contrast_on_white, colours.SERIES)) > 2.2


def test_another_mode_has_a_shade_too() -> None:
    assert colours.shade_of("FAILSAFE") == colours.MODES["FAILSAFE"]
    assert colours.shade_of("MANUAL") == colours.MODES[""]
