"""What the law `nmpc` carries from cycle to cycle, and how it reports the stem. Pure."""

from __future__ import annotations

import math
from dataclasses import field
from typing import TYPE_CHECKING

from positioner.laws.law import Estimate
from positioner.laws.nmpc.filter import Resting, Sliding
from positioner.laws.pushes import Pushes
from positioner.values import dataclass, replace
from positioner.valve.state import StemState
from positioner.wire.messages import Motion

if TYPE_CHECKING:
    from positioner.laws.nmpc.verification import RestMonitor
    from positioner.valve.stiction import LearnedSample


@dataclass(frozen=True, slots=True)
class Lateness:
    """By how many samples commands act late, and a number that was seen instead in so many of the last cycles."""

    samples: int = 0
    seen: int = 0
    times: int = 0

    def is_just(self, late: int) -> bool:
        """Whether commands that are `late` by so many samples are no news."""
        return late == self.samples and self.times == 0

    def followed_by(self, late: int) -> Lateness:
        """Return the lateness after a cycle in which commands are `late` by so many samples."""
        times = self.times + 1 if self.times and late == self.seen else 1
        return Lateness(late) if times >= _SURE or late == self.samples else Lateness(self.samples, late, times)


_SURE = 3
"""In so many cycles in a row a number of pending commands is no accident."""


@dataclass(frozen=True, slots=True)
class NmpcMemory:
    """What the law carries.

    stem: the estimate, of a sliding stem while motion is MOVE, else of a resting one.
    settle_s: remaining time in SETTLE. hold_ma: the current at rest, None to choose one.
    setpoint_m: the setpoint that the law pursues; is_new: whether the stem has not rested since it came; aim_m: where
        the move is to end for it; corrections: moves made for it so far; pushes: those that failed.
    ends_s: when the move must be over, in the law's time. lateness: of the commands.
    """

    stem: Resting | Sliding
    monitor: RestMonitor
    motion: Motion = Motion.REST
    settle_s: float = 0.0
    hold_ma: float | None = None
    setpoint_m: float | None = None
    is_new: bool = False
    aim_m: float = 0.0
    corrections: int = 0
    ends_s: float = math.inf
    pushes: Pushes = field(default_factory=Pushes)
    lateness: Lateness = field(default_factory=Lateness)


def with_resolution(memory: NmpcMemory, measured_m: float) -> NmpcMemory:
    """Return the memory with what this reading tells of the sensor's resolution; of a clean sensor nothing more."""
    known = memory.monitor.resolution
    resolution = known.followed_by(measured_m)
    if resolution is known:
        return memory
    return replace(memory, monitor=replace(memory.monitor, resolution=resolution))


def report(stem: Resting | Sliding, *lessons: LearnedSample) -> Estimate:
    """Return the estimate in the form that all laws share, with the `lessons` of this cycle."""
    if isinstance(stem, Resting):
        return Estimate(StemState(stem.x, 0.0, stuck=True, direction=stem.anchor.direction), lessons)
    return Estimate(StemState(stem.x, stem.v, stuck=False, direction=stem.direction), lessons)
