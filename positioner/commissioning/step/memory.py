"""What a step response test remembers: its state, the responses so far, and what the noise allows. Pure."""

from __future__ import annotations

import math
from enum import StrEnum
from typing import TYPE_CHECKING

from positioner.commissioning.known import Mean
from positioner.commissioning.record import Kind, stretch
from positioner.values import dataclass, replace

if TYPE_CHECKING:
    from positioner.commissioning.closed_loop import LoopState
    from positioner.commissioning.record import Trail
    from positioner.commissioning.stages import StageState
    from positioner.commissioning.step.ladder import Ladder, Rungs

_NEEDED_SIGMA = 6.0


class Doing(StrEnum):
    """The part of the test."""

    REST = "resting at the start"
    PLACE = "moving to the place of the steps, and measuring the noise"
    STEPS = "steps"
    LADDERS = "ladders to dead band and resolution"
    BACK = "returning to the start"


@dataclass(frozen=True, slots=True)
class Response:
    """What followed one step of `size` in `direction`.

    before_m: the mean of the last quarter of the wait before; final_m: that of the wait after. trail: the readings from
    the step on, earlier: those of the wait before, whose last one is the first of the trail. They become numbers only
    when no valve waits for its next step.
    """

    size: float
    direction: float
    before_m: float
    final_m: float
    trail: Trail | None
    earlier: Trail | None = None

    @property
    def measured_m(self) -> tuple[float, ...]:
        """The readings in m, at equal distances in time; a lost one is NaN."""
        return stretch(self.trail, Kind.STEP).measured_m

    @property
    def earlier_m(self) -> tuple[float, ...]:
        """The readings in m before the step, likewise."""
        return stretch(self.earlier, Kind.STEP).measured_m[:-1]


@dataclass(frozen=True, slots=True)
class StepMemory:
    """Where the test is.

    level: the present input; time_s: since it was asked for; mean: of the readings in the last quarter of the wait;
    trail, earlier: the readings since then, and those of the wait before.
    steps: the levels to come with size and direction, 0 for the way to a first level; ladders: those to come.
    loop: of the law, None at rest, where the current is held. correlation: see `Noise`.
    sigma_m: of a reading; seen_m: the smallest difference between two rests that is certain.
    home: the way back in open loop.
    """

    level: float
    start_m: float
    loop: LoopState | None = None
    doing: Doing = Doing.REST
    time_s: float = 0.0
    whole_s: float = 0.0
    mean: Mean = Mean()
    trail: Trail | None = None
    earlier: Trail | None = None
    before_m: float = 0.0
    steps: tuple[tuple[float, float, float], ...] = ()
    ladder: Ladder | None = None
    ladders: tuple[Ladder, ...] = ()
    correlation: float = 1.0
    sigma_m: float = 0.0
    seen_m: float = 0.0
    responses: tuple[Response, ...] = ()
    rungs: tuple[Rungs, ...] = ()
    home: StageState | None = None
    current_ma: float = 0.0
    aborted: str = ""
    ended: bool = False


def repeats_needed(size: float, sigma_m: float, span_m: float) -> int:
    """Return how many repeats a step needs that is to be 6σ/√repeats of the noise at least; size is one of span."""
    ratio = _NEEDED_SIGMA * sigma_m / (size * span_m)
    return max(math.ceil(ratio * ratio), 1)


def asks(memory: StepMemory, level: float) -> StepMemory:
    """Return the memory that begins to ask for a level."""
    return replace(memory, level=level, time_s=0.0, mean=Mean(), trail=None, earlier=memory.trail)
