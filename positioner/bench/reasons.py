"""Marks of the law's decisions in a picture: moves, by the source of Γ, and fallbacks. Pure drawing."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from positioner.laws.move_reason import BreakawaySource
from positioner.pictures.colours import BREAKAWAY, FALLBACK
from positioner.pictures.panels import CROSS, DOWN, HOLLOW, name

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
    """Instants in s, shape (any,): of moves with Γ from the table, of other moves, and of fallbacks."""

    by_table_s: NDArray[np.float64] = field(default_factory=_nothing)
    by_model_s: NDArray[np.float64] = field(default_factory=_nothing)
    fell_back_s: NDArray[np.float64] = field(default_factory=_nothing)


def reasons(time_s: NDArray[np.float64], moves: Sequence[BreakawaySource | None], fallbacks: Sequence[str]) -> Reasons:
    """Return the marks of the cycles at `time_s`.

    Args:
        time_s: instants of the cycles, shape (n,).
        moves: for each cycle that began a move the source of Γ, None for the others.
        fallbacks: for each cycle why the law fell back, empty where it did not.
    """
    moved = np.array([source is not None for source in moves], dtype=bool)
    by_table = np.array([source is BreakawaySource.TABLE for source in moves], dtype=bool)
    fell = np.array([bool(why) for why in fallbacks], dtype=bool)
    return Reasons(time_s[by_table], time_s[moved & ~by_table], time_s[fell])


def draw_reasons(panel: Axes, why: Reasons, below: int) -> None:
    """Draw the marks at the top of `panel`, and their names under the `below` names that it already has."""
    kinds = (
        (why.by_table_s, "Γ from table", "v", DOWN, BREAKAWAY, BREAKAWAY),
        (why.by_model_s, "Γ from model", "v", HOLLOW, BREAKAWAY, "white"),
        (why.fell_back_s, "fallback", "x", CROSS, FALLBACK, FALLBACK),
    )
    names = []
    for when_s, label, mark, sign, colour, inside in kinds:
        if len(when_s):
            heights = np.full(len(when_s), _HEIGHT)
            panel.plot(
                when_s, heights, mark, color=colour, markerfacecolor=inside, markeredgewidth=1.2,
                transform=panel.get_xaxis_transform(), markersize=6.0, zorder=5.0,
            )  # fmt: skip
            names.append((sign, colour, f"{len(when_s)} × {label}"))
    name(panel, names, below)
