"""The picture of a signature: the loop with its lines, the friction along the travel, and the breakaways. Shell."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from positioner.pictures.colours import BELIEF, CLOSING, INK, OPENING, REFERENCE
from positioner.pictures.files import save
from positioner.pictures.panels import HEAD, LABEL, NORMAL, dress, head, new_figure

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.axes import Axes

    from positioner.commissioning.signature import Signature
    from positioner.valve.parameters import ValveParameters

_MM = 1e3


def draw(path: Path, found: Signature, valve: ValveParameters, reference: dict[str, Any] | None) -> None:
    """Draw into `path`; a reference is laid under the friction."""
    figure = new_figure(5.2)
    left, right = figure.subplots(1, 2)
    figure.subplots_adjust(left=0.065, right=0.985, top=0.85, bottom=0.11, wspace=0.18)
    gain = valve.force_gain_n_per_ma
    for number, each in enumerate(found.strokes):
        label = ("opening", "closing")[number] if number < len(_SIDES) else None
        left.plot(each.position_m * _MM, each.pressure_ma, color=_SIDES[each.direction], lw=1.3, label=label)
    places_m = np.linspace(*found.reached_m)
    for side in (-1.0, 0.0, 1.0):
        force_n = found.spring_n_per_m.value * places_m + found.preload_n.value + side * found.sliding_n.value
        left.plot(places_m * _MM, force_n / gain, color=BELIEF, ls="--" if side else ":", lw=1.6)
    _label(left, "Loop; dotted: spring, dashed: with sliding friction", "pressure, as the current that holds it, mA")
    left.legend(fontsize=NORMAL, frameon=False)
    _friction(right, found, reference)
    head(figure, 0.065, ((f"{valve.id}: signature at {found.rate_ma_per_s:.3g} mA/s", HEAD, "bold", INK),))
    save(figure, path)


_SIDES = {1.0: OPENING, -1.0: CLOSING}


def _label(axes: Axes, title: str, y_label: str) -> None:
    dress(axes)
    axes.set_title(title, loc="left", fontsize=NORMAL, color=INK)
    axes.set_xlabel("position, mm", fontsize=LABEL)
    axes.set_ylabel(y_label, fontsize=LABEL)


def _friction(axes: Axes, found: Signature, reference: dict[str, Any] | None) -> None:
    if reference:
        earlier = np.asarray(reference["sliding_friction_by_place"])
        axes.plot(earlier[:, 0] * _MM, earlier[:, 1], color=REFERENCE, lw=5.0, label="sliding, reference")
    places = [each.position_m * _MM for each in found.by_place]
    axes.plot(places, [each.friction_n for each in found.by_place], color=INK, marker=".", label="sliding")
    for direction, mark, name in ((1.0, "^", "static, opening"), (-1.0, "v", "static, closing")):
        chosen = [each for each in found.breakaways if each.direction == direction]
        axes.plot(
            [each.position_m * _MM for each in chosen],
            [each.static_n for each in chosen],
            mark,
            color=_SIDES[direction],
            ms=8.0,
            label=name,
        )
    _label(axes, "Friction along the travel", "force, N")
    highest_n = max(*(each.static_n for each in found.breakaways), *(each.friction_n for each in found.by_place))
    axes.set_ylim(0.0, 1.15 * highest_n)
    axes.legend(loc="lower left", fontsize=NORMAL, frameon=False)
