"""What a stroke test remembers from cycle to cycle. Pure."""

from __future__ import annotations

import math
from enum import StrEnum
from typing import TYPE_CHECKING

from positioner.commissioning.known import SMOOTHING_S, Mean
from positioner.commissioning.record import longer
from positioner.values import dataclass, replace

if TYPE_CHECKING:
    from positioner.commissioning.closed_loop import LoopState
    from positioner.commissioning.record import Trail
    from positioner.commissioning.stroke.plan import Plan
    from positioner.laws.law import Observation


class Phase(StrEnum):
    """What the test does."""

    APPROACH = "moving to a place from which the stroke is possible"
    REST = "measuring the noise at rest"
    OUT = "stroke"
    COAST = "holding the current"
    PAUSE = "pause at the end of the stroke"
    BACK = "stroke back"
    AWAY = "moving away from the start, to return to it"
    RETURN = "returning to the start"
    SETTLE = "settling at the start"
    HOME = "moving back to where the stem was found"
    DEMAND = "moving to the new setpoint"
    ENDED = "ended"


class Cause(StrEnum):
    """Why a test was ended before its time; in the order in which they are looked for."""

    STOPPED = "stopped by the guard or a person"
    NEW_SETPOINT = "new setpoint"
    BEYOND = "beyond the stroke"
    STUCK = "stuck, breakaway too high"
    NO_MOTION = "no motion in time"
    OFF_COURSE = "off its course"
    TOO_LONG = "total time"
    NOT_POSSIBLE = "not possible here"


@dataclass(frozen=True, slots=True)
class Stop:
    """The end of a test before its time: cause, and current, place and time of this moment."""

    cause: Cause
    why: str
    current_ma: float
    position_m: float
    time_s: float


@dataclass(frozen=True, slots=True)
class Moved:
    """A breakaway: the phase, and the sample and the time at which the stem was seen to move.

    push_ma: how far the current was beyond the middle of the stick band there.
    """

    phase: Phase
    sample: int
    push_ma: float
    time_s: float


@dataclass(frozen=True, slots=True)
class StrokeMemory:
    """The state of a stroke test.

    began: the first sample of each phase, in their order; moved: the breakaways. from_m: where the stem rested before
    the present ramp. still_m, still_s: the place that it has not left since.
    asked_m: the setpoint at the start, NaN before a host has sent one. loop: of the law that
    pursues a new setpoint, or takes the stem to goal_m, where the stroke is possible.
    found_m: where the stem stood before it went there, and elsewhere: why the stroke was not possible from there; NaN
    and empty where it was. back_m: where it stood after the test, before it left for found_m.
    """

    phase: Phase
    current_ma: float
    asked_m: float
    first_m: float
    smooth_m: float
    time_s: float = 0.0
    phase_s: float = 0.0
    samples: int = 0
    mean: Mean = Mean()
    from_m: float = 0.0
    still_m: float = 0.0
    still_s: float = 0.0
    tries: int = 0
    plan: Plan | None = None
    trail: Trail | None = None
    began: tuple[tuple[Phase, int], ...] = ()
    moved: tuple[Moved, ...] = ()
    stop: Stop | None = None
    loop: LoopState | None = None
    goal_m: float = math.nan
    found_m: float = math.nan
    back_m: float = math.nan
    elsewhere: str = ""

    def observed(self, observation: Observation, period_s: float) -> StrokeMemory:
        """Return the memory with time, smoothed reading and record brought forward; the way home is in no record."""
        elapsed_s, measured_m = observation.elapsed_s, observation.measured_m
        smoothing_s = self.plan.smoothing_s if self.plan else SMOOTHING_S
        smooth_m = self.smooth_m + elapsed_s / (smoothing_s + elapsed_s) * (measured_m - self.smooth_m)
        seen_m = self.plan.seen_m if self.plan else 0.0
        left = abs(smooth_m - self.still_m) > seen_m
        recorded = self.phase is not Phase.HOME
        return replace(
            self,
            smooth_m=smooth_m,
            time_s=self.time_s + elapsed_s,
            phase_s=self.phase_s + elapsed_s,
            samples=self.samples + (max(round(elapsed_s / period_s), 1) if recorded else 0),
            still_m=smooth_m if left else self.still_m,
            still_s=0.0 if left else self.still_s + elapsed_s,
            trail=longer(self.trail, observation, period_s) if recorded else self.trail,
        )

    def then(self, phase: Phase) -> StrokeMemory:
        """Return the memory at the beginning of a phase; the next sample is its first one."""
        return replace(
            self,
            phase=phase,
            phase_s=0.0,
            mean=Mean(),
            from_m=self.smooth_m,
            still_m=self.smooth_m,
            still_s=0.0,
            began=(*self.began, (phase, self.samples)),
        )

    @property
    def breakaway(self) -> Moved | None:
        """The breakaway of the present phase; None while the stem rests."""
        return self.moved[-1] if self.moved and self.moved[-1].phase is self.phase else None
