"""Shaded spans behind the lines of a trend: when a mode was in force that is not the normal one, and its cause."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from positioner.pictures.colours import INK, MEASURED, shade_of
from positioner.pictures.panels import SMALL

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes

NARROWEST_LABEL = 0.012
"""Part of the width of a panel that a label takes, which stands upright."""


@dataclass(frozen=True, slots=True)
class Band:
    """A span from `begin` to `end`, in the unit of the axis: the mode's name, and mode and cause in words.

    notable: whether it is named however short it is; others only where they have room.
    """

    begin: float
    end: float
    mode: str
    words: str
    notable: bool = True


def draw_bands(panels: Sequence[Axes], bands: Sequence[Band], begin: float, end: float) -> None:
    """Shade the bands in every panel, and name them in the first one, whose axis goes from `begin` to `end`."""
    for panel in panels:
        for band in bands:
            # the edge keeps a short one visible
            panel.axvspan(
                band.begin, band.end, facecolor=shade_of(band.mode), edgecolor=shade_of(band.mode), linewidth=1.2,
                zorder=0,
            )  # fmt: skip
    for band in labelled(bands, begin, end):
        panels[0].annotate(
            band.words, (max(band.begin, begin), 0.02), xycoords=("data", "axes fraction"), xytext=(2, 0),
            textcoords="offset points", rotation=90, fontsize=SMALL, color=INK, va="bottom", zorder=6.0,
            bbox={"facecolor": "white", "edgecolor": MEASURED, "linewidth": 0.4, "alpha": 0.85, "pad": 1.0},
        )  # fmt: skip


def labelled(bands: Sequence[Band], begin: float, end: float) -> list[Band]:
    """Return the bands that are named: notable ones before others, then the longest; none where another name stands.

    The first of each kind goes before a second one.
    """
    room = NARROWEST_LABEL * (end - begin)
    seen: dict[str, int] = {}
    ranked: list[tuple[bool, int, float, Band]] = []
    for band in sorted(bands, key=lambda each: each.begin - each.end):
        before = seen[band.words] = seen.get(band.words, -1) + 1
        if band.notable or band.end - band.begin > room:
            ranked.append((not band.notable, before, band.begin - band.end, band))
    chosen: list[Band] = []
    for _, _, _, band in sorted(ranked, key=lambda each: each[:3]):
        if all(abs(band.begin - other.begin) >= room for other in chosen) and band.begin <= end - room:
            chosen.append(band)
    return chosen
