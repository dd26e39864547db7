"""A ladder: the input goes on in one direction in equal steps, until the stem moves, and until it moves again. Pure.

The stem comes onto the ladder's first place from the other side. The way to the first motion is the dead band, the way
from there to the next motion the resolution. A coarse ladder finds the region; a fine one begins a coarse step before
each motion.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import TYPE_CHECKING

from positioner.values import dataclass, replace

if TYPE_CHECKING:
    from positioner.commissioning.step.plan import Plan

_COARSE = 10
_ROUNDING = 1e-9


class Phase(IntEnum):
    """Where a ladder is."""

    AWAY = 0
    ONTO = 1
    DEAD_BAND = 2
    RESOLUTION = 3


@dataclass(frozen=True, slots=True)
class Found:
    """An input way: without motion up to `without`, with motion at `moved`; infinite where there was none."""

    without: float
    moved: float


@dataclass(frozen=True, slots=True)
class Rungs:
    """The result of one ladder in `direction`: what it found in steps of `rung`; no resolution without a motion."""

    direction: float
    rung: float
    dead_band: Found
    resolution: Found | None


@dataclass(frozen=True, slots=True)
class Ladder:
    """One ladder under way.

    skip_dead, skip_resolution: where its first steps lead at once, a part of the input's range.
    level: the present input; origin: the input at the reversal, or at the first motion; rest_m: the stem there.
    """

    direction: float
    rung: float
    skip_dead: float = 0.0
    skip_resolution: float = 0.0
    phase: Phase = Phase.AWAY
    level: float = 0.0
    before: float = 0.0
    origin: float = 0.0
    rest_m: float = 0.0
    dead_band: Found | None = None

    def began(self, plan: Plan) -> Ladder:
        """Return the ladder on its way to the far side of its first place."""
        return replace(self, level=_side(plan, self.direction))

    def next(self, plan: Plan, mean_m: float, observable_m: float) -> Ladder | Rungs:
        """Return the ladder after the wait at its level, where the stem was at `mean_m`; its result at the end."""
        match self.phase:
            case Phase.AWAY:
                return replace(self, phase=Phase.ONTO, level=_side(plan, -self.direction))
            case Phase.ONTO:
                first = replace(self, phase=Phase.DEAD_BAND, origin=self.level, rest_m=mean_m)
                return first.up(plan, self.skip_dead or self.rung)
            case _:
                pass
        if self.direction * (mean_m - self.rest_m) <= observable_m:
            return self.up(plan, self.way + self.rung)
        found = Found(abs(self.before - self.origin), self.way)
        if self.dead_band is not None:
            return Rungs(self.direction, self.rung, self.dead_band, found)
        after = replace(self, phase=Phase.RESOLUTION, origin=self.level, rest_m=mean_m, dead_band=found)
        return after.up(plan, self.skip_resolution or self.rung)

    @property
    def way(self) -> float:
        """How far the input is from the origin."""
        return abs(self.level - self.origin)

    def up(self, plan: Plan, way: float) -> Ladder | Rungs:
        """Return the ladder that goes on to `way` from its origin, or its result where the range ends before."""
        level = self.origin + self.direction * way
        if plan.low - _ROUNDING <= level <= plan.high + _ROUNDING:
            return replace(self, before=self.level, level=level)
        nothing = Found(self.way, math.inf)
        if self.dead_band is None:
            return Rungs(self.direction, self.rung, nothing, None)
        return Rungs(self.direction, self.rung, self.dead_band, nothing)


def coarse(direction: float, rung: float) -> Ladder:
    """Return the ladder that finds the region."""
    return Ladder(direction, _COARSE * rung)


def fine(found: Rungs, rung: float) -> Ladder:
    """Return the ladder that begins where a coarse one saw no motion yet."""
    resolution = found.resolution.without if found.resolution else 0.0
    return Ladder(found.direction, rung, found.dead_band.without, resolution)


def _side(plan: Plan, direction: float) -> float:
    """Return the input at the end, on the side of `direction`, of the way onto the place of a ladder."""
    middle = 0.5 * (plan.low + plan.high) if plan.is_open else plan.place
    return min(max(middle + direction * 0.5 * plan.approach, plan.low), plan.high)
