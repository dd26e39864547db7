"""The breakaway current Γ: from the stiction table where it has good samples, else from the model (paper §5.2). Pure.

Inside a cell of the table Γ rises with the spring by K·(cell width)/B, more than a tenth of F_s. So the table holds Γ
at the centre of the cell, and the spring force between the centre and the stem is added when Γ is read.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.laws.move_reason import Breakaway
from positioner.valve.motion import Load
from positioner.valve.stiction import LearnedSample, Quantity, direction_of

if TYPE_CHECKING:
    from positioner.laws.nmpc.settings import BreakawaySettings
    from positioner.valve.motion import MotionModel
    from positioner.valve.stiction import StictionTable


def breakaway(
    settings: BreakawaySettings,
    model: MotionModel,
    table: StictionTable,
    position_m: float,
    direction: float,
    spring_n_per_m: float,
    static_n: float,
) -> Breakaway:
    """Return Γ for a stem resting at `position_m` that is to move in `direction` (±1): (K·x ± F_s)/B, or the table's.

    The table's Γ is the mean of the cell and one spread, so that most pushes free the stem. It is never less than the
    newest sample, and never less than 0.9 of the model's F_s: otherwise, with a wrong table, the law would push in vain
    for ever.
    """
    spare_n = direction * settings.margin * static_n
    cell = table.cell(Quantity.BREAKAWAY_CURRENT, position_m, direction_of(direction))
    if (
        cell is None
        or cell.count < settings.least_count
        or table.age(cell) > settings.largest_age
        or cell.spread * model.gain_n_per_ma > settings.largest_spread * static_n
    ):
        return Breakaway(model.current_ma(spring_n_per_m * position_m + direction * static_n + spare_n))
    pushes = (cell.mean + direction * cell.spread, cell.samples[-1])
    centre_m = table.index_of(position_m) * table.cell_width_m
    least_ma = model.current_ma(spring_n_per_m * centre_m + direction * _LEAST_OF_MODEL * static_n)
    carried_n = spring_n_per_m * (position_m - centre_m) + spare_n
    push_ma = max(*pushes, least_ma) if direction > 0.0 else min(*pushes, least_ma)
    return Breakaway(push_ma + carried_n / model.gain_n_per_ma, len(cell.samples), table.age(cell))


_LEAST_OF_MODEL = 0.9
"""The least push as a part of the model's F_s, for a table whose values are too low."""


def breakaway_lesson(
    model: MotionModel, cell_width_m: float, position_m: float, direction: float, spring_n_per_m: float, static_n: float
) -> LearnedSample:
    """Return the sample for the table: Γ in mA at the centre of the cell that holds `position_m`."""
    centre_m = math.floor(position_m / cell_width_m + 0.5) * cell_width_m
    current_ma = model.current_ma(spring_n_per_m * centre_m + direction * static_n)
    return LearnedSample(Quantity.BREAKAWAY_CURRENT, centre_m, direction_of(direction), current_ma)


def load_from_table(
    settings: BreakawaySettings, model: MotionModel, table: StictionTable, prior: Load, sigmas: Load, ratio: float
) -> tuple[Load, Load]:
    """Return the load that a table implies, and its standard deviations; `prior` and `sigmas` for an empty table.

    K and F_s are the least-squares solution of B·Γ = K·x ± F_s over the newest Γ of each breakaway cell, together with
    the prior; old and scattered cells are left out. F_c is F_s/`ratio`. Each Γ was computed from the K and F_s of its
    time, so a newer one counts more, and a cell counts once, however many samples it has. F_v changes in proportion to
    F_c, since packing that grips harder does so at every speed. The table of a valve without friction is not used:
    there is nothing to break away from.
    """
    static_n = ratio * prior.friction_n
    if static_n < _SURE:
        return prior, sigmas
    sure_n = max(max(settings.margin, _LEAST_DOUBT) * static_n, _SURE)
    # information matrix [[a, b], [b, c]] and vector (d, e) of the deviations from the prior
    a, b, c = _information(sigmas.spring_n_per_m), 0.0, _information(ratio * sigmas.friction_n)
    d, e = 0.0, 0.0
    for key, cell in table:
        spread_n = cell.spread * model.gain_n_per_ma
        if (
            key.quantity is not Quantity.BREAKAWAY_CURRENT
            or table.age(cell) > settings.largest_age
            or spread_n > settings.largest_spread * static_n
        ):
            continue
        x, s = key.index * table.cell_width_m, key.direction.sign
        error_n = model.push_n(cell.samples[-1], s, static_n) - prior.spring_n_per_m * x
        weight = math.pow(_FADING, table.age(cell)) / (sure_n * sure_n)
        a, b, c = a + weight * x * x, b + weight * x * s, c + weight
        d, e = d + weight * x * error_n, e + weight * s * error_n
    det = a * c - b * b
    friction_n = prior.friction_n + (a * e - b * d) / (det * ratio)
    grip = friction_n / prior.friction_n
    load = Load(prior.spring_n_per_m + (c * d - b * e) / det, friction_n, prior.viscous_n_s_per_m * grip)
    return load, Load(math.sqrt(c / det), math.sqrt(a / det) / ratio, sigmas.viscous_n_s_per_m)


def _information(sigma: float) -> float:
    sure = max(sigma, _SURE)
    return 1.0 / (sure * sure)


_FADING = 0.9
"""Weight of a cell's newest sample for each sample learned since, anywhere."""
_SURE = 1e-3
"""N/m or N: the least standard deviation of a prior or a sample; less static friction counts as none."""
_LEAST_DOUBT = 0.03
"""The least uncertainty of a cell as a part of F_s: its samples and its neighbours share most of their error."""
