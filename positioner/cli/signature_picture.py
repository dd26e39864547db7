"""The picture of a signature: the loop with its lines, the friction along the travel, and the breakaways. Shell."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np

from positioner.commissioning.loop_branches import branches, slow_and_sliding
from positioner.commissioning.procedure import ProcedureLimits

mpl.use("Agg")
from matplotlib import pyplot as plt

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from matplotlib.axes import Axes

    from positioner.commissioning.record import Stretch
    from positioner.commissioning.signature import Signature
    from positioner.config.schema import Configuration

_MM = 1e3


def draw(
    path: Path,
    stretches: Sequence[Stretch],
    found: Signature,
    configuration: Configuration,
    reference: dict[str, Any] | None,
) -> None:
    """Draw into `path`; a reference is laid under the friction."""
    valve = configuration.valve
    limits = ProcedureLimits.of(valve, configuration.guard)
    figure, (left, right) = plt.subplots(1, 2, figsize=(13.0, 5.2), layout="constrained")
    gain = valve.force_gain_n_per_ma
    _, sliding = slow_and_sliding(branches(stretches, valve, limits, configuration.control.sample_period_s))
    for number, each in enumerate(sliding):
        label = ("opening", "closing")[number] if number < len(_SIDES) else None
        left.plot(each.position_m * _MM, each.pressure_ma, color=_SIDES[each.direction], lw=1.0, label=label)
    places_m = np.linspace(*found.reached_m)
    for side in (-1.0, 0.0, 1.0):
        force_n = found.spring_n_per_m.value * places_m + found.preload_n.value + side * found.sliding_n.value
        left.plot(places_m * _MM, force_n / gain, "k--" if side else "k:", lw=1.0)
    left.set(
        title="Loop; dotted: spring, dashed: with sliding friction",
        xlabel="position, mm",
        ylabel="pressure, as the current that holds it, mA",
    )
    left.legend()
    _friction(right, found, reference)
    figure.suptitle(f"{valve.id}: signature at {found.rate_ma_per_s:.3g} mA/s")
    figure.savefig(path, dpi=110)
    plt.close(figure)


_SIDES = {1.0: "#0072B2", -1.0: "#D55E00"}


def _friction(axes: Axes, found: Signature, reference: dict[str, Any] | None) -> None:
    if reference:
        earlier = np.asarray(reference["sliding_friction_by_place"])
        axes.plot(earlier[:, 0] * _MM, earlier[:, 1], color="0.6", lw=4.0, label="sliding, reference")
    places = [each.position_m * _MM for each in found.by_place]
    axes.plot(places, [each.friction_n for each in found.by_place], "k.-", label="sliding")
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
    axes.set(title="Friction along the travel", xlabel="position, mm", ylabel="force, N")
    highest_n = max(*(each.static_n for each in found.breakaways), *(each.friction_n for each in found.by_place))
    axes.set_ylim(0.0, 1.15 * highest_n)
    axes.legend(loc="lower left")
