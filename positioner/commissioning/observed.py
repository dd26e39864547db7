"""What a fit compares: the readings of slips, and the positions that a set of parameters θ gives them. Pure."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from positioner.commissioning.slips import Candidates

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from positioner.commissioning.slips import Slips
    from positioner.valve.parameters import ValveParameters

    Array = NDArray[np.float64]

SPRING, PRELOAD, STATIC, COULOMB, VISCOUS, STRIBECK, FILL, VENT, DEAD = range(9)
COUNT = 9
"""The places of the parameters in θ, and their number."""


def theta_of(valve: ValveParameters) -> Array:
    """Return θ, an array of COUNT, of a valve as it is configured."""
    actuator = valve.actuator
    return np.array(
        [
            valve.spring_rate_n_per_m,
            valve.bench_set_n,
            valve.static_friction_n,
            valve.coulomb_friction_n,
            valve.viscous_friction_n_s_per_m,
            valve.stribeck_velocity_m_per_s,
            actuator.fill_time_constant_s,
            actuator.vent_time_constant_s,
            actuator.dead_time_s,
        ]
    )


@dataclass(frozen=True, slots=True)
class Observed:
    """Slips with the weight of each reading (1/σ in 1/m, 0 where it does not count), and their place of rest before."""

    slips: Slips
    weight: Array
    rest_m: Array
    rest_sigma_m: Array


def sets_of(theta: Array, own: Array, observed: Observed, mass_kg: float, gain: float) -> Candidates:
    """Return sets of parameters for `play`: θ as (set, parameter), own as (set, 2, slip)."""
    columns = [theta[:, number : number + 1] for number in range(COUNT)]
    coulomb = np.minimum(columns[COULOMB], (1.0 - 1e-3) * columns[STATIC])
    return Candidates(
        mass_kg,
        gain,
        columns[SPRING],
        columns[PRELOAD],
        columns[STATIC],
        coulomb,
        columns[VISCOUS],
        columns[STRIBECK],
        np.maximum(columns[FILL], 0.0),
        np.maximum(columns[VENT], 0.0),
        np.maximum(columns[DEAD], 0.0),
        observed.rest_m[None, :] + own[:, 0, :],
        1.0 + own[:, 1, :],
    )


def residuals(observed: Observed, positions_m: Array) -> Array:
    """Return the weighted differences to the readings, as an array of (sample, set, slip)."""
    readings = observed.slips.measured_m[:, observed.slips.begins :].T[:, None, :]
    weight = observed.weight[:, observed.slips.begins :].T[:, None, :]
    return np.where(weight > 0.0, (np.nan_to_num(readings) - positions_m) * weight, 0.0)


def excess(off: Array, block: int) -> float:
    """Return the variance of the sums of `block` weighted residuals, over that of white noise of σ = 1; at least 1.

    It exceeds 1 where the residuals are larger than the noise, or where neighbours are alike: where the model is wrong,
    as with friction that varies along the stroke.
    """
    sums = off[: len(off) // block * block].reshape(-1, block).sum(axis=1)
    return max(float(np.mean(sums * sums)) / block, 1.0) if len(sums) else 1.0


def weakened(observed: Observed, by: float) -> Observed:
    """Return the slips with the variance of each reading `by` times as large."""
    return replace(observed, weight=observed.weight / np.sqrt(by))
