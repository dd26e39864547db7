"""The procedure of a partial stroke test: a slow ramp frees the stem, it slides, rests, and slides back. Pure.

- At rest: the noise of the sensor, and the place to return to.
- A ramp, until the stem moves: the breakaway force. The current goes on, so that the stem slides.
- Shortly before the end of the stroke the current is held: a stem that goes on shows how late the air follows.
- In the middle of the stick band the friction stops the stem. After a pause, the same way back.

Where the current cannot do that from where the stem stands, the law of the valve first takes the stem to the nearest
place from which it can, and afterwards back, as far as the current reaches.

A new setpoint ends the test at once. The law of the valve then takes the stem there, with all the current it has.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.commissioning.known import Mean
from positioner.commissioning.procedure import Progress
from positioner.commissioning.stroke.aborts import first_broken
from positioner.commissioning.stroke.memory import Cause, Phase, Stop, StrokeMemory
from positioner.commissioning.stroke.plan import place_near_m, plan_of
from positioner.commissioning.stroke.way_back import back, freed, settled
from positioner.values import dataclass, replace

if TYPE_CHECKING:
    from positioner.commissioning.closed_loop import ClosedLoop
    from positioner.commissioning.procedure import ProcedureLimits
    from positioner.commissioning.stroke.plan import Plan
    from positioner.commissioning.stroke.settings import StrokeSettings
    from positioner.laws.law import Observation
    from positioner.valve.parameters import ValveParameters

_REST_S = 2.0
_SETTLED_OF_REST = 1.0 / 3.0
"""Until here the stem may still move, for the current has jumped; the readings of the rest count for the test."""
_FEWEST, _SIGMA = 10, 6.0
"""Readings whose mean says where the stem is, and how certain that must be."""
_DEMAND_REACHED_OF_SPAN = 0.01
_DEMAND_REST_S = 2.0
_DEMAND_S = 30.0
_FULL_OF_SPAN = 0.005
_MM = 1e3


@dataclass(frozen=True, slots=True)
class StrokeTest:
    """The procedure, for one valve and one period.

    loop: takes the stem to a new setpoint, or to a place from which the stroke is possible.
    """

    valve: ValveParameters
    limits: ProcedureLimits
    settings: StrokeSettings
    period_s: float
    loop: ClosedLoop
    name: str = "stroke-test"

    def begin(self, measured_m: float) -> StrokeMemory:
        """Return the memory at the start, at a reading in m."""
        current_ma = self._within(self.valve.balance_current_ma(measured_m))
        memory = StrokeMemory(Phase.REST, current_ma, math.nan, measured_m, measured_m)
        return replace(memory, began=((Phase.REST, 0),))

    def advance(self, memory: StrokeMemory, observation: Observation) -> tuple[StrokeMemory, float]:
        """Return the memory with this cycle's observation in it, and the current in mA."""
        if memory.phase is Phase.ENDED:
            return memory, memory.current_ma
        before_ma = memory.current_ma
        memory = memory.observed(observation, self.period_s)
        memory = self._asked(memory, observation)
        match memory.phase:
            case Phase.DEMAND:
                memory = self._demanded(memory, observation)
            case Phase.APPROACH:
                memory = self._approached(memory, observation)
            case Phase.HOME:
                memory, _, is_over = self._pursued(memory, observation, memory.found_m)
                memory = memory.then(Phase.ENDED) if is_over else memory
            case _:
                memory = self._looked_at(memory)
                memory = memory if memory.phase is Phase.ENDED else self._tested(memory, observation)
                memory = self._homeward(memory, observation.measured_m) if memory.phase is Phase.ENDED else memory
        step_ma = self.limits.rate_ma_per_s * observation.elapsed_s
        current_ma = self._within(min(max(memory.current_ma, before_ma - step_ma), before_ma + step_ma))
        return replace(memory, current_ma=current_ma), current_ma

    def progress(self, memory: StrokeMemory) -> Progress:
        """Return how far the test is, by the expected time."""
        ended = memory.phase is Phase.ENDED
        return Progress(1.0 if ended else min(memory.time_s / self.expected_s(), 0.99), memory.phase, ended)

    def expected_s(self) -> float:
        """Return how long the test of a healthy valve lasts, in s."""
        plan = plan_of(self.valve, self.limits, self.settings, self.period_s, 0.0, 0.0)
        stroke_s = plan.static_ma / self.settings.rate_ma_per_s + plan.aim_m / plan.speed_m_per_s
        return _REST_S + 2.0 * stroke_s + plan.coast_s + self.settings.pause_s + 1.0

    def abort(self, memory: StrokeMemory, why: str) -> StrokeMemory:
        """Return the memory of a test that brings the stem back because it was stopped from outside."""
        if memory.stop or memory.phase in {Phase.HOME, Phase.ENDED}:
            return memory
        return self._stopped(memory, Stop(Cause.STOPPED, why, memory.current_ma, memory.smooth_m, memory.time_s))

    def _within(self, current_ma: float) -> float:
        return min(max(current_ma, self.limits.current_low_ma), self.limits.current_high_ma)

    def _asked(self, memory: StrokeMemory, observation: Observation) -> StrokeMemory:
        """Return the memory, with a demand where the host asks for another place than at first, or than the stem's.

        No single reading says where the stem is: at first its mean does, as soon as it is certain enough.
        """
        asked_m, setpoint_m = memory.asked_m, observation.setpoint_m
        if memory.phase is Phase.DEMAND or (math.isnan(asked_m) and setpoint_m == _held_m(memory, self.valve)):
            return memory
        most_m = self.settings.demand_of_span * self.limits.span_m
        if math.isnan(asked_m):
            begins_m = setpoint_m if memory.plan is None else memory.plan.start_m
            asked_m = begins_m if math.isnan(memory.found_m) else memory.found_m
        memory = replace(memory, asked_m=setpoint_m if math.isnan(memory.asked_m) else memory.asked_m)
        if abs(setpoint_m - asked_m) <= most_m and not self._stands_elsewhere(memory, asked_m):
            return memory
        why = f"the host asks for {setpoint_m * _MM:.1f} mm"
        stop = Stop(Cause.NEW_SETPOINT, why, memory.current_ma, memory.smooth_m, memory.time_s)
        memory = replace(memory, stop=memory.stop or stop, asked_m=setpoint_m)
        return replace(memory.then(Phase.DEMAND), loop=self.loop.begin(observation.measured_m))

    def _stands_elsewhere(self, memory: StrokeMemory, asked_m: float) -> bool:
        """Return whether a stem that has not been moved yet certainly stands elsewhere; it need not be exact."""
        if memory.plan is not None or not math.isnan(memory.found_m) or memory.mean.count < _FEWEST:
            return False
        unsure_m = _SIGMA * memory.mean.sigma_m / math.sqrt(memory.mean.count)
        return abs(asked_m - memory.mean.mean_m) > self.settings.tolerance_of_span * self.limits.span_m + unsure_m

    def _demanded(self, memory: StrokeMemory, observation: Observation) -> StrokeMemory:
        """Return the memory with the current that takes the stem to the setpoint: an end of the travel at once."""
        setpoint_m, valve = observation.setpoint_m, self.valve
        memory, _, is_over = self._pursued(memory, observation, setpoint_m)
        part = (setpoint_m - valve.travel_min_m) / valve.span_m
        if part <= _FULL_OF_SPAN or part >= 1.0 - _FULL_OF_SPAN:
            current_ma = self.limits.current_low_ma if part <= _FULL_OF_SPAN else self.limits.current_high_ma
            memory = replace(memory, current_ma=current_ma)
        return memory.then(Phase.ENDED) if is_over else memory

    def _pursued(
        self, memory: StrokeMemory, observation: Observation, goal_m: float
    ) -> tuple[StrokeMemory, bool, bool]:
        """Return the memory on the way to a place, whether the stem rests there, and whether this is over."""
        assert memory.loop is not None  # noqa: S101 - it begins with the phase
        loop, current_ma = self.loop.current_ma(memory.loop, observation, goal_m)
        near = abs(memory.smooth_m - goal_m) <= _DEMAND_REACHED_OF_SPAN * self.limits.span_m
        rests = near and memory.still_s > _DEMAND_REST_S
        return replace(memory, loop=loop, current_ma=current_ma), rests, rests or memory.phase_s > _DEMAND_S

    def _approached(self, memory: StrokeMemory, observation: Observation) -> StrokeMemory:
        """Return the memory on the way to where the stroke is possible; there the test begins."""
        memory, rests, is_over = self._pursued(memory, observation, memory.goal_m)
        if rests:
            fresh = self.begin(observation.measured_m)
            kept = replace(fresh, asked_m=memory.asked_m, first_m=memory.first_m, elsewhere=memory.elsewhere)
            return replace(kept, found_m=memory.found_m, goal_m=memory.goal_m)
        if not is_over:
            return memory
        why = f"the stem has not come to {memory.goal_m * _MM:.1f} mm in {_DEMAND_S:g} s: {memory.elsewhere}"
        stop = Stop(Cause.NOT_POSSIBLE, why, memory.current_ma, memory.smooth_m, memory.time_s)
        return self._homeward(replace(memory, stop=stop), observation.measured_m)

    def _homeward(self, memory: StrokeMemory, measured_m: float) -> StrokeMemory:
        """Return the memory of a test that is over: on the way to where the stem was found, or ended.

        A stem that is stuck stays; so does one whose old place the current does not reach.
        """
        memory = memory if memory.phase is Phase.ENDED else memory.then(Phase.ENDED)
        low_m, high_m = self.valve.reach_m(self.limits.current_low_ma, self.limits.current_high_ma)
        is_stuck = memory.stop is not None and memory.stop.cause in {Cause.STUCK, Cause.NO_MOTION}
        if is_stuck or not low_m <= memory.found_m <= high_m:
            return memory
        return replace(memory.then(Phase.HOME), back_m=memory.smooth_m, loop=self.loop.begin(measured_m))

    def _looked_at(self, memory: StrokeMemory) -> StrokeMemory:
        """Return the memory, stopped where a criterion holds."""
        if memory.stop:
            return memory
        plan = memory.plan or self._plan(memory, 0.0)
        stop = first_broken(self.settings, memory, plan)
        return self._stopped(memory, stop) if stop else memory

    def _stopped(self, memory: StrokeMemory, stop: Stop) -> StrokeMemory:
        """Return the memory of a test that is over, with the stem still to be brought back."""
        memory = replace(memory, stop=stop)
        if memory.plan is None or memory.phase is Phase.APPROACH:
            return self._homeward(memory, memory.smooth_m)
        return replace(memory.then(Phase.SETTLE), current_ma=memory.plan.balance_ma(memory.smooth_m))

    def _plan(self, memory: StrokeMemory, sigma_m: float) -> Plan:
        start_m = memory.mean.mean_m if memory.mean.count else memory.smooth_m
        return plan_of(self.valve, self.limits, self.settings, self.period_s, start_m, sigma_m)

    def _tested(self, memory: StrokeMemory, observation: Observation) -> StrokeMemory:
        """Return the memory with what the present phase asks for."""
        plan = memory.plan
        if plan is None:
            return self._rested(memory, observation)
        match memory.phase:
            case Phase.OUT:
                return self._out(memory, plan, observation)
            case Phase.COAST:
                return _coasted(memory, plan)
            case Phase.PAUSE:
                return self._paused(memory, plan, observation)
            case Phase.SETTLE:
                return settled(memory, plan, self.limits, observation)
            case _:
                return back(memory, plan, self.limits, self.settings, observation)

    def _rested(self, memory: StrokeMemory, observation: Observation) -> StrokeMemory:
        """Measure the place and the noise; then begin, where the current can do the stroke."""
        settled_s = _SETTLED_OF_REST * _REST_S
        before = Mean() if memory.phase_s - observation.elapsed_s < settled_s <= memory.phase_s else memory.mean
        memory = replace(memory, mean=before.add(observation.measured_m))
        if memory.phase_s < _REST_S:
            return memory
        plan = self._plan(memory, memory.mean.sigma_m)
        why = self._impossible(plan)
        goal_m = place_near_m(self.valve, self.limits, plan)
        if why and self.settings.approach and goal_m is not None and math.isnan(memory.found_m):
            loop = self.loop.begin(observation.measured_m)
            memory = replace(memory.then(Phase.APPROACH), plan=plan, loop=loop, goal_m=goal_m)
            return replace(memory, found_m=plan.start_m, elsewhere=why)
        memory = replace(memory, plan=plan, smooth_m=plan.start_m)
        if why:
            why += ": begin elsewhere" if goal_m is not None else ": nor can it elsewhere; make the stroke smaller"
            stop = Stop(Cause.NOT_POSSIBLE, why, memory.current_ma, memory.smooth_m, memory.time_s)
            return replace(memory, stop=stop).then(Phase.ENDED)
        return replace(memory.then(Phase.OUT), current_ma=self._within(plan.rest_ma), from_m=plan.start_m)

    def _impossible(self, plan: Plan) -> str:
        """Return why the valve cannot do the stroke from its place, empty where it can."""
        limits, valve = self.limits, self.valve
        end_m = plan.start_m + plan.way * plan.aim_m
        if not limits.travel_min_m <= end_m <= limits.travel_max_m:
            return f"the stroke from {plan.start_m * _MM:.1f} mm would end at a stop"
        reach_m = valve.reach_m(limits.current_low_ma, limits.current_high_ma)
        free_m = valve.restartable_m(limits.current_low_ma, limits.current_high_ma)
        for place_m, way in ((end_m, -plan.way), (plan.start_m, plan.way)):
            if not reach_m[0] <= place_m <= reach_m[1]:
                text = f"the current ([guard]) cannot take the stem to {place_m * _MM:.1f} mm: it reaches "
                return text + f"{reach_m[0] * _MM:.1f} to {reach_m[1] * _MM:.1f} mm"
            if (way < 0.0 and place_m < free_m[0]) or (way > 0.0 and place_m > free_m[1]):
                text = f"the current ([guard]) cannot free the stem at {place_m * _MM:.1f} mm: it does between "
                return text + f"{free_m[0] * _MM:.1f} and {free_m[1] * _MM:.1f} mm"
        return ""

    def _out(self, memory: StrokeMemory, plan: Plan, observation: Observation) -> StrokeMemory:
        memory = freed(memory, plan)
        if memory.breakaway and plan.gone_m(memory.smooth_m) >= plan.coast_from_m:
            return memory.then(Phase.COAST)
        rate = plan.rate_ma_per_s if memory.breakaway else self.settings.rate_ma_per_s
        return replace(memory, current_ma=self._within(memory.current_ma + plan.way * rate * observation.elapsed_s))

    def _paused(self, memory: StrokeMemory, plan: Plan, observation: Observation) -> StrokeMemory:
        pause_s = self.settings.pause_s
        if 2.0 * memory.phase_s >= pause_s:
            memory = replace(memory, mean=memory.mean.add(observation.measured_m))
        if memory.phase_s < pause_s:
            return memory
        here_m = memory.mean.mean_m
        return replace(memory.then(Phase.BACK), from_m=here_m, still_m=here_m, current_ma=plan.balance_ma(here_m))


def _held_m(memory: StrokeMemory, valve: ValveParameters) -> float:
    """Return the setpoint in m of a positioner to which no host has sent one: where it began."""
    return min(max(memory.first_m, valve.travel_min_m), valve.travel_max_m)


def _coasted(memory: StrokeMemory, plan: Plan) -> StrokeMemory:
    """Hold the current, until a stem that is not slow stands, or one that is has gone far enough."""
    if memory.phase_s < plan.coast_s and plan.gone_m(memory.smooth_m) < plan.coast_to_m:
        return memory
    return replace(memory.then(Phase.PAUSE), current_ma=plan.balance_ma(memory.smooth_m))
