"""The step response test as a procedure: rest, steps of each size up and down, ladders both ways, and back. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.commissioning.homing import Return
from positioner.commissioning.known import Line
from positioner.commissioning.noise import noise_of
from positioner.commissioning.procedure import Progress
from positioner.commissioning.record import Kind, longer, stretch
from positioner.commissioning.stages import StageState, World
from positioner.commissioning.step.ladder import Ladder, coarse, fine
from positioner.commissioning.step.memory import Doing, Response, StepMemory, asks, repeats_needed
from positioner.values import dataclass, replace

if TYPE_CHECKING:
    from positioner.commissioning.closed_loop import ClosedLoop
    from positioner.commissioning.procedure import ProcedureLimits
    from positioner.commissioning.step.plan import Plan
    from positioner.laws.law import Observation
    from positioner.valve.parameters import ValveParameters

_SEEN_SIGMA = 4.0
_QUARTER = 0.25
_RUNGS, _OPEN_RUNGS = 7, 18
"""Usual waits of a ladder, for the progress."""


@dataclass(frozen=True, slots=True)
class StepTest:
    """The step response test of a valve by a plan, with a law in the loop or without one."""

    valve: ValveParameters
    limits: ProcedureLimits
    period_s: float
    plan: Plan
    loop: ClosedLoop
    name: str = "step-test"

    def begin(self, measured_m: float) -> StepMemory:
        """Return the memory at the start, at a reading in m."""
        balance_ma = self._world(measured_m).within(self.valve.balance_current_ma(measured_m))
        return StepMemory(self._part(measured_m), measured_m, current_ma=balance_ma)

    def advance(self, memory: StepMemory, observation: Observation) -> tuple[StepMemory, float]:
        """Return the memory with this cycle's observation in it, and the current in mA."""
        if memory.ended:
            return memory, memory.current_ma
        if memory.home is not None:
            return self._homing(memory, memory.home, observation)
        memory = self._observed(memory, observation)
        if memory.time_s > self.plan.wait_s - 0.5 * self.period_s:
            memory = self._next(memory)
            memory = replace(memory, trail=longer(None, replace(observation, elapsed_s=self.period_s), self.period_s))
        if memory.doing is Doing.REST or memory.home is not None:
            return memory, memory.current_ma
        loop = memory.loop or self.loop.begin(observation.measured_m)
        loop, current_ma = self.loop.current_ma(loop, observation, self._setpoint_m(memory.level))
        limits = self.limits
        within_ma = min(max(current_ma, limits.current_low_ma), limits.current_high_ma)
        return replace(memory, loop=loop, current_ma=within_ma), current_ma

    def progress(self, memory: StepMemory) -> Progress:
        """Return how far the test is, by the number of its waits."""
        part = 1.0 if memory.ended else min(memory.whole_s / self.expected_s(), 0.99)
        return Progress(part, memory.doing.value, memory.ended, memory.aborted)

    def expected_s(self) -> float:
        """Return how long the test is expected to last, in s."""
        plan = self.plan
        ladders = 2 * (_OPEN_RUNGS if plan.is_open else _RUNGS) * (1 + plan.repeats) if plan.ladder else 0
        return plan.wait_s * (3 + len(plan.sizes) * ((3 if plan.is_open else 1) + 2 * plan.repeats) + ladders)

    def abort(self, memory: StepMemory, why: str) -> StepMemory:
        """Return the memory of a test that brings the stem back, and has no result."""
        if memory.aborted or memory.ended:
            return memory
        return self._back(replace(memory, aborted=why))

    def _observed(self, memory: StepMemory, observation: Observation) -> StepMemory:
        """Return the memory with a reading: in the mean of the last quarter, and in the trail where it is kept."""
        time_s = memory.time_s + observation.elapsed_s
        mean, trail = memory.mean, memory.trail
        if time_s > (1.0 - _QUARTER) * self.plan.wait_s:
            mean = mean.add(observation.measured_m)
        if memory.doing in {Doing.REST, Doing.PLACE, Doing.STEPS}:
            trail = longer(trail, observation, self.period_s)
        whole_s = memory.whole_s + observation.elapsed_s
        return replace(memory, time_s=time_s, whole_s=whole_s, mean=mean, trail=trail)

    def _next(self, memory: StepMemory) -> StepMemory:
        """Return the memory at the end of a wait, with the next level."""
        mean_m = memory.mean.mean_m
        match memory.doing:
            case Doing.REST:
                correlation = noise_of((stretch(memory.trail, Kind.REST),)).correlation
                memory = replace(memory, start_m=mean_m, correlation=correlation, doing=Doing.PLACE)
                memory = asks(memory, self.plan.place)
            case Doing.PLACE:
                memory = self._first_step(memory)
            case Doing.STEPS:
                memory = self._after_step(memory, mean_m)
            case Doing.LADDERS:
                memory = self._after_rung(memory, mean_m)
            case _:
                near = abs(mean_m - memory.start_m) < 0.005 * self.limits.span_m
                memory = replace(memory, ended=True) if near or memory.time_s > 3.0 * self.plan.wait_s else memory
        return replace(memory, before_m=mean_m)

    def _first_step(self, memory: StepMemory) -> StepMemory:
        """Return the memory that knows the noise, and begins with the steps that it allows."""
        rest = stretch(memory.trail, Kind.REST)
        half = replace(rest, measured_m=rest.measured_m[len(rest.measured_m) // 2 :])
        noise = noise_of((half,))
        # a stem that still moves is no correlated noise: that is known from the rest under a held current
        sigma_m = float(noise.sigma_m(memory.mean.mean_m)) / noise.correlation * memory.correlation
        samples = max(_QUARTER * self.plan.wait_s / self.period_s, 1.0)
        seen_m = max(_SEEN_SIGMA * sigma_m * math.sqrt(2.0 / samples), self.plan.observable * self.limits.span_m)
        memory = replace(memory, doing=Doing.STEPS, sigma_m=sigma_m, seen_m=seen_m)
        steps = []
        for size in self.plan.sizes:
            if repeats_needed(size, sigma_m, self.limits.span_m) <= self.plan.repeats:
                low, high = self.plan.place - 0.5 * size, self.plan.place + 0.5 * size
                # in open loop where the first step leads depends on where the stem came from
                before = ((low, 0.0, 0.0), (high, 0.0, 0.0), (low, 0.0, 0.0))[: 3 if self.plan.is_open else 1]
                steps += [*before, *((high, size, 1.0), (low, size, -1.0)) * self.plan.repeats]
        return self._step(replace(memory, steps=tuple(steps)))

    def _step(self, memory: StepMemory) -> StepMemory:
        """Return the memory that asks for the next step, or goes on to the ladders."""
        if memory.steps:
            return asks(memory, memory.steps[0][0])
        plan = self.plan
        if not plan.ladder:
            return self._back(memory)
        rung = self.rung(memory)
        return self._ladder(replace(memory, doing=Doing.LADDERS, ladders=(coarse(1.0, rung), coarse(-1.0, rung))))

    def rung(self, memory: StepMemory) -> float:
        """Return the step of the fine ladder: no smaller than a motion that the noise lets be seen."""
        if self.plan.is_open:
            return self.plan.ladder
        return max(self.plan.ladder, memory.seen_m / self.limits.span_m)

    def _after_step(self, memory: StepMemory, mean_m: float) -> StepMemory:
        """Return the memory with the response to the step that has been waited for."""
        _, size, direction = memory.steps[0]
        responses = memory.responses
        if direction:
            responses = (*responses, Response(size, direction, memory.before_m, mean_m, memory.trail, memory.earlier))
        return self._step(replace(memory, steps=memory.steps[1:], responses=responses))

    def _after_rung(self, memory: StepMemory, mean_m: float) -> StepMemory:
        """Return the memory with the next rung, or the next ladder."""
        assert memory.ladder is not None  # noqa: S101 - there is one while this is done
        after = memory.ladder.next(self.plan, mean_m, memory.seen_m)
        if isinstance(after, Ladder):
            return asks(replace(memory, ladder=after), after.level)
        rung = self.rung(memory)
        if after.rung > rung:
            fines = (fine(after, rung),) * self.plan.repeats
            return self._ladder(replace(memory, ladders=(*memory.ladders, *fines)))
        return self._ladder(replace(memory, rungs=(*memory.rungs, after)))

    def _ladder(self, memory: StepMemory) -> StepMemory:
        """Return the memory that begins the next ladder, or goes back."""
        if not memory.ladders:
            return self._back(memory)
        ladder = memory.ladders[0].began(self.plan)
        return asks(replace(memory, ladder=ladder, ladders=memory.ladders[1:]), ladder.level)

    def _back(self, memory: StepMemory) -> StepMemory:
        """Return the memory on its way back: by the law, or in open loop past the start and onto it."""
        memory = replace(memory, doing=Doing.BACK)
        if self.plan.is_open:
            return replace(memory, home=StageState(current_ma=memory.current_ma))
        return asks(memory, self._part(memory.start_m))

    def _homing(self, memory: StepMemory, home: StageState, observation: Observation) -> tuple[StepMemory, float]:
        _, home = Return().advance(self._world(memory.start_m), home, observation)
        whole_s = memory.whole_s + observation.elapsed_s
        memory = replace(memory, home=home, whole_s=whole_s, current_ma=home.current_ma, ended=home.done)
        return memory, home.current_ma

    def _world(self, start_m: float) -> World:
        return World(self.limits, self.period_s, Line.believed(self.valve), start_m=start_m)

    def _part(self, position_m: float) -> float:
        return (position_m - self.valve.travel_min_m) / self.limits.span_m

    def _setpoint_m(self, level: float) -> float:
        return self.valve.travel_min_m + level * self.limits.span_m
