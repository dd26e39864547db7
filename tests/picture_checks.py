"""What must hold of every picture: text that can be read on a screen, inside the picture, and not over other text."""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from matplotlib.text import Text
    from matplotlib.transforms import Bbox

SCREEN_PX, SCREEN_DPI = 1200.0, 96.0
"""A picture as wide as a page shows it."""
LEAST_PT = 9.0
_ROUNDING = 1e-6


def texts_of(figure: Figure) -> list[tuple[Text, Bbox]]:
    """Return every text that is drawn, with its place in pixels of the figure."""
    figure.canvas.draw()
    shown: list[Text] = [*figure.texts, *(text for legend in figure.legends for text in legend.get_texts())]
    for axes in figure.axes:
        shown += _texts_on(axes)
    found = [(each, each.get_window_extent()) for each in shown if each.get_visible() and each.get_text().strip()]
    return [(each, box) for each, box in found if box.width > 0.0]


def _texts_on(axes: Any) -> list[Text]:
    """Return the texts of a panel; ticks outside its limits have one that is never drawn."""
    legend = axes.get_legend()
    own = [*axes.texts, *(legend.get_texts() if legend else ())]
    if not axes.axison:
        return own
    own += [axes.title, axes._left_title, axes._right_title]
    for axis in (axes.xaxis, axes.yaxis):
        own += [axis.label, axis.get_offset_text()]
        own += [label for tick in axis._update_ticks() for label in (tick.label1, tick.label2)]
    return own


def points_on_a_screen(text: Text, figure: Figure) -> float:
    """Return the size of a text in points, on a screen of 96 dpi where the picture is 1200 pixels wide."""
    pixels = float(text.get_fontsize()) / 72.0 * figure.dpi
    return pixels * SCREEN_PX / float(figure.bbox.width) * 72.0 / SCREEN_DPI


def check(figure: Figure, *, most_overlap: float = 0.02) -> None:
    """Fail where a text is too small, sticks out of the picture, or covers another one."""
    found = texts_of(figure)
    assert len(found) > 3
    small = {t.get_text(): points_on_a_screen(t, figure) for t, _ in found}
    assert {text: size for text, size in small.items() if size < LEAST_PT - _ROUNDING} == {}
    page = figure.bbox
    outside = [t.get_text() for t, b in found if b.x0 < -1 or b.y0 < -1 or b.x1 > page.x1 + 1 or b.y1 > page.y1 + 1]
    assert outside == [], f"outside of the picture: {outside}"
    covered = [
        (one.get_text(), other.get_text())
        for (one, box), (other, beside) in combinations(found, 2)
        if _shared(box, beside) > most_overlap * min(box.width * box.height, beside.width * beside.height)
    ]
    assert covered == [], f"text over text: {covered}"


def _shared(one: Bbox, other: Bbox) -> float:
    width = min(one.x1, other.x1) - max(one.x0, other.x0)
    height = min(one.y1, other.y1) - max(one.y0, other.y0)
    return float(max(width, 0.0) * max(height, 0.0))
