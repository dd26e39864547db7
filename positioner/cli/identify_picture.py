"""The picture of an identification: the signature, the breakaways, and the steps with their fit. Shell."""

from __future__ import annotations

from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np

from positioner.commissioning.played import played_steps
from positioner.commissioning.record import Kind

mpl.use("Agg")
from matplotlib import pyplot as plt

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from matplotlib.axes import Axes

    from positioner.commissioning.identified import IdentifiedValve
    from positioner.commissioning.record import Stretch
    from positioner.config.schema import Configuration

_AFTER_S = 0.4


def draw(path: Path, stretches: Sequence[Stretch], found: IdentifiedValve, configuration: Configuration) -> None:
    """Draw into `path`."""
    figure, (left, middle, right) = plt.subplots(1, 3, figsize=(15.0, 5.0), layout="constrained")
    valve, period_s = found.laid_over(configuration.valve), configuration.control.sample_period_s
    gain = valve.force_gain_n_per_ma
    for number, each in enumerate(one for one in stretches if one.kind is Kind.STROKE):
        label = f"{each.rate_ma_per_s:g} mA/s" if number % 2 == 0 else None
        left.plot(each.applied_ma, np.asarray(each.measured_m) * 1e3, color=f"C{number // 2}", lw=0.8, label=label)
    position_m = np.linspace(*valve.reach_m(configuration.guard.current_low_ma, configuration.guard.current_high_ma))
    for side in (-1.0, 0.0, 1.0):
        force_n = valve.spring_rate_n_per_m * position_m + valve.bench_set_n + side * valve.coulomb_friction_n
        left.plot(force_n / gain, position_m * 1e3, "k--" if side else "k:", lw=1.0)
    left.set(title="Signature; dashed: spring ± sliding friction", xlabel="current, mA", ylabel="position, mm")
    left.legend()
    _breakaways(middle, stretches, found, gain)
    for each, modelled_m in played_steps(stretches, valve, period_s):
        end = min(each.slip + round(_AFTER_S / period_s), len(each.measured_m))
        time_ms = (np.arange(each.held, end) - each.held) * period_s * 1e3
        rest_m = float(np.nanmean(each.measured_m[each.held // 4 : each.held]))
        (line,) = right.plot(time_ms, (np.asarray(each.measured_m[each.held : end]) - rest_m) * 1e3, ".", ms=2.0)
        right.plot(time_ms, (modelled_m[each.held : end] - rest_m) * 1e3, color=line.get_color(), lw=1.0)
    right.set(title="Steps: readings, and the fitted valve", xlabel="time after the step, ms", ylabel="way, mm")
    figure.suptitle(f"{valve.id}: identification")
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _breakaways(axes: Axes, stretches: Sequence[Stretch], found: IdentifiedValve, gain: float) -> None:
    slips = [each for each in stretches if each.kind is Kind.BREAKAWAY]
    place_mm = [1e3 * float(np.nanmean(each.measured_m[each.held // 4 : each.held])) for each in slips]
    spring, preload = found.spring_rate_n_per_m.value, found.bench_set_n.value
    force_n = [
        each.direction * (gain * each.applied_ma[each.slip - 1] - preload - spring * place * 1e-3)
        for each, place in zip(slips, place_mm, strict=True)
    ]
    for direction, mark in ((1.0, "^"), (-1.0, "v")):
        chosen = [number for number, each in enumerate(slips) if each.direction == direction]
        axes.plot([place_mm[number] for number in chosen], [force_n[number] for number in chosen], mark, ms=7.0)
    axes.axhspan(found.static_friction_n.low, found.static_friction_n.high, alpha=0.3, label="static friction, 95 %")
    axes.axhspan(
        found.coulomb_friction_n.low, found.coulomb_friction_n.high, color="C1", alpha=0.3, label="sliding friction"
    )
    axes.set(title="Force when a slip was seen, lag included", xlabel="position, mm", ylabel="force, N")
    axes.legend()
