"""The experiment of `identify`: rest, strokes, breakaways from rest, overdriven steps, and back to the start. Pure.

- At rest: the noise of the sensor.
- Strokes over the whole range of the current, at three rates: the spring, the friction of the sliding stem, and how
  the command leads the pressure.
- Breakaways by a slow ramp from rest: the static friction. A stroke cannot show it, because its stem slides.
- Steps well beyond the breakaway: lag and dead time of the actuator. A valve that answers within some hundredths of a
  second makes many more of them.

After a breakaway or a step the current returns to the middle of the stick band, where the friction stops the stem.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.commissioning.homing import Return
from positioner.commissioning.known import Line
from positioner.commissioning.procedure import Progress
from positioner.commissioning.release import Release
from positioner.commissioning.stages import Rest, SlideUp, Stage, StageState, Stroke, World
from positioner.values import dataclass, replace

if TYPE_CHECKING:
    from positioner.commissioning.procedure import ProcedureLimits
    from positioner.commissioning.record import Stretch
    from positioner.laws.law import Observation
    from positioner.valve.parameters import ValveParameters

_REST_S = 3.0
_APPROACH_MA_PER_S = 4.0
RATES_MA_PER_S = (2.0, 4.0, 8.0)
_BREAKAWAYS = 10
_OVER = (0.3, 1.2, 0.6, 0.3, 1.2, 0.6, 0.3, 1.2)
"""How far beyond the breakaway the steps go, as a part of it."""
_REPEATS, _REPEATED_OVER = 40, 0.6


@dataclass(frozen=True, slots=True)
class IdentifyMemory:
    """Where the experiment is: its number of the stage and the state in it, what is known, and what was recorded."""

    number: int
    state: StageState
    world: World
    stretches: tuple[Stretch, ...] = ()
    aborted: str = ""
    ended: bool = False


@dataclass(frozen=True, slots=True)
class Experiment:
    """A procedure of stages, for one valve and one period: that of `identify`, or of `signature`."""

    valve: ValveParameters
    limits: ProcedureLimits
    period_s: float
    stages: tuple[Stage, ...]
    """In their order; the last one brings the stem back."""
    name: str = "identify"

    @classmethod
    def of(cls, valve: ValveParameters, limits: ProcedureLimits, period_s: float) -> Experiment:
        """Return the experiment for the valve as it is configured, within the limits."""
        return cls(valve, limits, period_s, stages_of(limits))

    def begin(self, measured_m: float) -> IdentifyMemory:
        """Return the memory at the start, at a reading in m."""
        line = Line.believed(self.valve)
        world = World(self.limits, self.period_s, line, start_m=measured_m)
        current_ma = world.within(line.balance_ma(measured_m))
        return IdentifyMemory(0, StageState(current_ma=current_ma), world)

    def advance(self, memory: IdentifyMemory, observation: Observation) -> tuple[IdentifyMemory, float]:
        """Return the memory with this cycle's observation in it, and the current in mA."""
        if memory.ended:
            return memory, memory.state.current_ma
        stages = self.stages
        stage = stages[memory.number]
        world, state = stage.advance(memory.world, memory.state, observation)
        current_ma = world.towards(memory.state.current_ma, state.current_ma, math.inf, observation.elapsed_s)
        state = replace(state, current_ma=current_ma)
        if state.implausible and not memory.aborted:
            memory = replace(memory, world=world, state=state)
            return self.abort(memory, state.implausible), state.current_ma
        if not state.done:
            return replace(memory, state=state, world=world), state.current_ma
        stretches = memory.stretches if memory.aborted else (*memory.stretches, *stage.recorded(state))
        ended = memory.number + 1 == len(stages)
        after = IdentifyMemory(
            number=memory.number if ended else memory.number + 1,
            state=StageState(current_ma=state.current_ma, smooth_m=state.smooth_m),
            world=world,
            stretches=stretches,
            aborted=memory.aborted,
            ended=ended,
        )
        return after, state.current_ma

    def progress(self, memory: IdentifyMemory) -> Progress:
        """Return how far the experiment is, by the expected time of its stages."""
        stages = self.stages
        lasts = [stage.lasts_s(memory.world) for stage in stages]
        done_s = sum(lasts[: memory.number]) + min(memory.state.time_s, lasts[memory.number])
        part = 1.0 if memory.ended else done_s / sum(lasts)
        return Progress(part, stages[memory.number].doing, memory.ended, memory.aborted)

    def expected_s(self) -> float:
        """Return how long the experiment is expected to last, in s."""
        world = World(self.limits, self.period_s, Line.believed(self.valve), start_m=0.0)
        return sum(stage.lasts_s(world) for stage in self.stages)

    def abort(self, memory: IdentifyMemory, why: str) -> IdentifyMemory:
        """Return the memory of an experiment that brings the stem back, and has no result."""
        if memory.aborted or memory.ended:
            return memory
        state = StageState(current_ma=memory.state.current_ma, smooth_m=memory.state.smooth_m)
        return replace(memory, number=len(self.stages) - 1, state=state, aborted=why)


def stages_of(limits: ProcedureLimits) -> tuple[Stage, ...]:
    """Return the stages within the limits."""
    low_ma, high_ma, most = limits.current_low_ma, limits.current_high_ma, limits.rate_ma_per_s
    strokes = [
        Stroke(to_ma, min(rate, most), shows_line=number == 0)
        for number, rate in enumerate(RATES_MA_PER_S)
        for to_ma in (high_ma, low_ma)
    ]
    breakaways = [Release(direction=1.0 if number % 2 == 0 else -1.0, over=0.0) for number in range(_BREAKAWAYS)]
    steps = [Release(direction=1.0 if number % 2 == 0 else -1.0, over=over) for number, over in enumerate(_OVER)]
    repeats = [
        Release(direction=1.0 if number % 2 == 0 else -1.0, over=_REPEATED_OVER, repeats=True)
        for number in range(_REPEATS)
    ]
    return (
        Rest(_REST_S),
        Stroke(low_ma, min(_APPROACH_MA_PER_S, most), records=False),
        *strokes,
        SlideUp(0.5),
        *breakaways,
        *steps,
        *repeats,
        Return(),
    )
