"""Saving a picture: a PNG and, beside it, an SVG that is the same in every run. Shell."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.figure import Figure

BOTH = (".png", ".svg")
"""The files of a picture."""
_SVG: Any = {
    "svg.hashsalt": "positioner",
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans", "Verdana", "Arial"],
}
"""Text stays text, so that it can be searched and selected; identifiers do not change from run to run."""


def save(figure: Figure, path: Path) -> None:
    """Write `figure` as PNG and as SVG: at `path`, and beside it with the other suffix.

    A path with another suffix gets that one format. No display is needed, and no state of matplotlib is used.
    """
    FigureCanvasAgg(figure)
    given = path.suffix.lower()
    if given not in {"", *BOTH}:
        figure.savefig(path)
        return
    figure.savefig(path if given == ".png" else path.with_suffix(".png"), metadata={"Software": None})
    with rc_context(_SVG):
        to = path if given == ".svg" else path.with_suffix(".svg")
        figure.savefig(to, metadata={"Date": None, "Creator": None})
