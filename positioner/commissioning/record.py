"""What a procedure records: stretches of readings, each with what the procedure did there. Pure."""

from __future__ import annotations

import math
from enum import StrEnum
from typing import TYPE_CHECKING

from positioner.values import dataclass

if TYPE_CHECKING:
    from positioner.laws.law import Observation


class Kind(StrEnum):
    """What the procedure did in a stretch."""

    REST = "rest"
    STROKE = "stroke"
    BREAKAWAY = "breakaway"
    STEP = "step"


@dataclass(frozen=True, slots=True)
class Trail:
    """The newest sample of a stretch that is being recorded, linked to the one before."""

    measured_m: float
    applied_ma: float
    pressure_pa: float
    before: Trail | None


@dataclass(frozen=True, slots=True)
class Stretch:
    """Samples at equal distances in time; a lost reading is NaN.

    applied_ma acted between the reading before and this one; pressure_pa is empty without a pressure sensor.
    direction: of the force, ±1, 0 at rest; rate_ma_per_s: of a stroke or of the ramp to a breakaway.
    held: the number of samples at the beginning in which the current was constant; slip: the sample in which the
        procedure saw the stem move.
    """

    kind: Kind
    direction: float
    rate_ma_per_s: float
    held: int
    slip: int
    measured_m: tuple[float, ...]
    applied_ma: tuple[float, ...]
    pressure_pa: tuple[float, ...]


def longer(trail: Trail | None, observation: Observation, period_s: float) -> Trail:
    """Return the trail with an observation, and NaN for the readings that were lost before it."""
    pressure_pa = math.nan if observation.pressure_pa is None else observation.pressure_pa
    for _ in range(round(observation.elapsed_s / period_s) - 1):
        trail = Trail(math.nan, observation.applied_ma, pressure_pa, trail)
    return Trail(observation.measured_m, observation.applied_ma, pressure_pa, trail)


def stretch(
    trail: Trail | None, kind: Kind, direction: float = 0.0, rate_ma_per_s: float = 0.0, held: int = 0, slip: int = 0
) -> Stretch:
    """Return what a trail recorded."""
    samples: list[Trail] = []
    while trail is not None:
        samples.append(trail)
        trail = trail.before
    samples.reverse()
    measured = not any(math.isnan(sample.pressure_pa) for sample in samples)
    return Stretch(
        kind,
        direction,
        rate_ma_per_s,
        held,
        slip,
        tuple([sample.measured_m for sample in samples]),
        tuple([sample.applied_ma for sample in samples]),
        tuple([sample.pressure_pa for sample in samples]) if measured else (),
    )
