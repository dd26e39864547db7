"""Marks of the law's decisions in a picture: moves and fallbacks. Pure drawing."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from positioner.pictures.colours import BREAKAWAY, FALLBACK
from positioner.pictures.panels import CROSS, DOWN, name

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from numpy.typing import NDArray

_HEIGHT = 0.955
"""Height of the marks, as a part of the panel."""


def _nothing() -> NDArray[np.float64]:
    return np.zeros(0)


@dataclass(frozen=True, slots=True)
class Reasons:
    """Instants in s, shape (any,): of begun moves and of fallbacks."""

    moved_s: NDArray[np.float64] = field(default_factory=_nothing)
    fell_back_s: NDArray[np.float64] = field(default_factory=_nothing)


def reasons(time_s: NDArray[np.float64], moves: Sequence[bool], fallbacks: Sequence[str]) -> Reasons:
    """Return the marks of the cycles at `time_s`.

    Args:
        time_s: instants of the cycles, shape (n,).
        moves: for each cycle whether it began a move.
        fallbacks: for each cycle why the law fell back, empty where it did not.
    """
    moved = np.array(moves, dtype=bool)
    fell = np.array([bool(why) for why in fallbacks], dtype=bool)
    return Reasons(time_s[moved], time_s[fell])


def draw_reasons(panel: Axes, why: Reasons, below: int) -> None:
    """Draw the marks at the top of `panel`, and their names under the `below` names that it already has."""
    kinds = (
        (why.moved_s, "Γ", "v", DOWN, BREAKAWAY),
        (why.fell_back_s, "fallback", "x", CROSS, FALLBACK),
    )
    names = []
    for when_s, label, mark, sign, colour in kinds:
        if len(when_s):
            heights = np.full(len(when_s), _HEIGHT)
            panel.plot(
                when_s, heights, mark, color=colour, markeredgewidth=1.2, transform=panel.get_xaxis_transform(),
                markersize=6.0, zorder=5.0,
            )  # fmt: skip
            names.append((sign, colour, f"{len(when_s)} × {label}"))
    name(panel, names, below)
