"""Elements of every panel of a picture: lines in steps, fitting limits, names at the right. Pure drawing."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from positioner.bench.curves import envelope

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray


def line(
    panel: Axes,
    time_s: NDArray[np.float64],
    values: NDArray[np.float64],
    colour: str,
    *,
    width: float,
    alpha: float = 1.0,
    zorder: float = 4.0,
) -> None:
    """Draw `values` (n,) over `time_s` (n,) in steps: a bound that is active for a single sample is visible."""
    panel.plot(
        *envelope(time_s, values), color=colour, linewidth=width, alpha=alpha, drawstyle="steps-post", zorder=zorder
    )


def fit(panel: Axes, curves: list[NDArray[np.float64]], percentiles: tuple[float, float]) -> None:
    """Set the limits so that these percentiles of every curve with values are inside, with a margin."""
    known = [curve[np.isfinite(curve)] for curve in curves]
    inside = np.array([np.percentile(values, percentiles) for values in known if len(values)])
    if not len(inside):
        return
    low, high = float(inside.min()), float(inside.max())
    margin = 0.2 * (high - low) or 1.0
    panel.set_ylim(low - margin, high + margin)


def name(panel: Axes, names: list[tuple[str, str]], below: int = 0) -> None:
    """Write the names of a panel's lines at its right, each in the colour of its line, under `below` other ones."""
    for row, (label, colour) in enumerate(names, start=below):
        panel.annotate(
            label, (1.008, 0.96), xycoords="axes fraction", xytext=(0, -17 * row), textcoords="offset points",
            color=colour, fontsize=11.5, fontweight="bold", va="top",
        )  # fmt: skip
