"""Predictive moves while they converge, quasi-static ones where they do not: the law `nmpc` without lag. Pure.

A predictive move is fast, and ends where its model says as long as the model is right. A quasi-static one ends where
spring and friction balance the pressure, whatever the speed of the stem is; it takes longer. So the predictive law
moves the stem until it does not keep the contract of convergence:

    at one setpoint no more than one move misses its aim by more than 1 % of span;
    the stem does not stay away from its setpoint for longer than a move and its correction take;
    the readings are not for long elsewhere than where the predictive law believes the stem.

Then the quasi-static law takes this setpoint over, and the next ones, four at first and twice as many each time that it
happens again; and as long as what it has measured says that a predictive move of the configured model would miss: where
the stem is freed or lands differs by more than 1 % of span, or is not known so well.
A predictive move brakes the stem while it slides. Where a slip is over within a few samples there is nothing to brake
by, and the quasi-static law comes first at every setpoint (`ConvergingLaw.quasi_static_first`).
A predictive correction is made where it pays (`laws.correction`), and after some moves to a setpoint where the next
one is expected to halve the error, as they have ended: a correction is another slip, and takes the stem away before it
brings it back.
If the quasi-static law leaves the stem away from its setpoint, the predictive law goes on there: it pushes harder, and
again after rests, for ever.
"""

from __future__ import annotations

import math
from enum import Enum
from typing import TYPE_CHECKING, Any

from positioner.laws.correction import LEFT, pays
from positioner.values import dataclass, replace

if TYPE_CHECKING:
    from positioner.laws.law import Decision, Estimate, Law, Observation
    from positioner.laws.move_reason import MoveReason
    from positioner.laws.quasi_static.law import QuasiStaticLaw
    from positioner.laws.quasi_static.memory import QuasiStaticMemory
    from positioner.valve.parameters import ValveParameters
    from positioner.valve.state import StemState
    from positioner.valve.stiction import StictionTable

_MISS, _MOST_MISSES = 0.01, 1
"""A move that ends more than 1 % of span from its aim has missed it: a dwell that ends so is lost (docs/robustness.md).
One at each setpoint is allowed: it teaches spring and friction."""
_GOOD = 0.005
"""Of span: so near to its setpoint a stem was brought well, as in the robustness test's *reachable*."""
_SMALL = 0.003
"""The first move to a setpoint of more than 0.3 % of span is made at any price, so a change of the setpoint by that
much is followed."""
_ENOUGH, _HALVED = 4, 2.0
"""Then an error must exceed 2 σ of the ends of the moves to this setpoint, four at least: a move halves it on
average. With two, fewer moves are made, and a valve whose friction scatters is left up to 0.4 % of span off; without
this, 316 instead of 298 dwells of all valves of the robustness test are lost (DESIGN.md, "What a correction must
pay")."""
_ASTRAY, _ASTRAY_S = 3.0, 0.1
"""σ of a reading, besides 1 % of span, by which the readings may differ from the stem that the predictive law believes
in, and for how long: a stem that moves, seen through a sensor that lags, is at rest by then."""
_LAGS, _REST_S = 8.0, 0.1
"""A move and its correction last four time constants each, e⁻⁴ = 2 %; between them a rest is judged."""
_ELSEWHERE = 0.01
"""Of span: a setpoint that is nearer to the last one is no new one (as in `laws.pushes`)."""
_SMOOTHING_S = 0.02
"""Of the reading whose distance to the setpoint counts: some periods, and shorter than any patience."""
_FIRST_PAUSE, _LONGEST_PAUSE = 4, 64
"""Setpoints for which the quasi-static law moves the stem after a failure of the predictive one."""
_SIGNAL_MA = 16.0
"""4 to 20 mA: the longest way of the current, which a limit of its change makes slow."""
_COARSE = 0.6
"""Times √(m/K), the time of a free stem. A slip lasts half a swing, π √(m/K): with a longer period than 0.6 √(m/K) it
is over within five samples. On all valves of the robustness test 0.4, 0.6, 0.8 and 1.2 lose 380, 380, 402 and 426
dwells (DESIGN.md, "Who moves when")."""


class Acting(Enum):
    """Which law moves the stem."""

    PREDICTIVE = "predictive"
    QUASI_STATIC = "quasi-static"
    AGAIN = "predictive, since quasi-static moves have not led to this setpoint"


@dataclass(frozen=True, slots=True)
class Dwell:
    """What has happened at one setpoint.

    aim_m, way_m: of the last move, if it was to end at the setpoint; else None and 0. misses: moves that missed their
    aim. ended, missed_m2: those that halved their way, and the sum of the squares of their distances from their aims.
    left_m: the setpoint, where the stem is left as near to it as it is; else None. away_s: for how long the stem has
    been away, where that counts. lost_s: for how long since predictive moves have failed.
    """

    setpoint_m: float
    aim_m: float | None = None
    way_m: float = 0.0
    ended: int = 0
    missed_m2: float = 0.0
    misses: int = 0
    left_m: float | None = None
    away_s: float = 0.0
    lost_s: float = 0.0


BEFORE_THE_FIRST = Dwell(math.inf)
"""Every setpoint is elsewhere."""


@dataclass(frozen=True, slots=True)
class ConvergingMemory:
    """What the law carries: both memories, which one acts, the smoothed reading in m, and the present dwell.

    pause, left: setpoints that the last failure gave to the quasi-static law, and those of them that are still to come.
    taken_over_m: where the quasi-static law took the stem over. astray_m: how far the smoothed readings are from the
    stem that the predictive law believes in, and astray_s for how long that is too far. begun_s: when the last
    predictive move began, None once it has ended; slid: whether the stem has slid since. lasts_s: how long the last
    such move took.
    """

    predictive: Any
    quasi_static: QuasiStaticMemory
    smooth_m: float
    lasts_s: float
    acting: Acting = Acting.PREDICTIVE
    dwell: Dwell = BEFORE_THE_FIRST
    pause: int = 0
    left: int = 0
    taken_over_m: float = 0.0
    astray_m: float = 0.0
    astray_s: float = 0.0
    begun_s: float | None = None
    slid: bool = False


@dataclass(frozen=True, slots=True)
class ConvergingLaw:
    """The law.

    patience_s: how long a stem may be away from its setpoint. reach_m: where the configured valve can go.
    quasi_static_first: quasi-static moves come first at each setpoint.
    """

    name: str
    predictive: Law[Any]
    quasi_static: QuasiStaticLaw
    span_m: float
    patience_s: float
    reach_m: tuple[float, float]
    quasi_static_first: bool

    def begin(self, measured_m: float) -> ConvergingMemory:
        """Return the memory of a law that starts at this reading, in m."""
        predictive, quasi_static = self.predictive.begin(measured_m), self.quasi_static.begin(measured_m)
        return ConvergingMemory(predictive, quasi_static, measured_m, 0.5 * self.patience_s)

    def estimate(self, memory: ConvergingMemory, observation: Observation) -> tuple[ConvergingMemory, Estimate]:
        """Return the memory with this cycle's reading in it, and the estimate of the law that acts."""
        smooth_m = _smoothed_m(memory.smooth_m, observation.measured_m, observation.elapsed_s)
        if memory.acting is Acting.QUASI_STATIC:
            quasi_static, estimate = self.quasi_static.estimate(memory.quasi_static, observation)
            return replace(memory, quasi_static=quasi_static, smooth_m=smooth_m), estimate
        predictive, estimate = self.predictive.estimate(memory.predictive, observation)
        return replace(memory, predictive=predictive, smooth_m=smooth_m), estimate

    def decide(
        self, memory: ConvergingMemory, stem: StemState, observation: Observation, table: StictionTable
    ) -> tuple[ConvergingMemory, Decision]:
        """Return the memory and the decision of the law that acts, or of the one that takes over."""
        setpoint_m = observation.setpoint_m
        if abs(setpoint_m - memory.dwell.setpoint_m) > _ELSEWHERE * self.span_m:
            memory = self._at_new_setpoint(memory, setpoint_m)
            is_due = not memory.left and self._leads(memory)
            if memory.acting is Acting.QUASI_STATIC and is_due and memory.quasi_static.move.stage is None:
                return self._predictive_begins(memory, Acting.PREDICTIVE, observation, table)
            if memory.acting is not Acting.QUASI_STATIC and (memory.left or self.quasi_static_first):
                return self._quasi_static_begins(memory, observation, table)
        if memory.acting is Acting.QUASI_STATIC:
            quasi_static, decision = self.quasi_static.decide(memory.quasi_static, stem, observation, table)
            rests = memory.quasi_static.move.stage is None and quasi_static.move.stage is None
            sees = quasi_static.rest.readings > 0  # where the stem is
            dwell = self._waited(memory, observation, counts=rests and sees)
            if dwell.away_s > self.patience_s + _LAGS * max(quasi_static.more_lag_s, 0.0):
                return self._predictive_begins(memory, Acting.AGAIN, observation, table)
            memory = replace(memory, quasi_static=quasi_static, dwell=dwell)
            return memory, self._told(memory, decision)
        memory = self._timed(self._compared(memory, stem, observation), stem, observation.time_s)
        is_left = memory.dwell.left_m == setpoint_m and self._is_small(memory, stem, setpoint_m)
        predictive, decision = self._predicted(memory, stem, observation, table, is_left=is_left)
        dwell = self._followed(memory, stem, observation, decision)
        reason = decision.reason
        if reason is not None and not is_left and self._is_vain(memory, dwell, stem, setpoint_m, reason):
            dwell = replace(memory.dwell, left_m=setpoint_m)
            predictive, decision = self._predicted(memory, stem, observation, table, is_left=True)
        if memory.acting is Acting.PREDICTIVE and (why := self._broken(memory, dwell, stem, setpoint_m)):
            memory, decision = self._quasi_static_begins(self._failed(memory, setpoint_m), observation, table)
            return memory, replace(decision, fallback=f"{why}: quasi-static moves take over")
        if decision.reason is not None:
            memory = replace(memory, begun_s=observation.time_s, slid=False)
        return replace(memory, predictive=predictive, dwell=dwell), self._told(memory, decision)

    def _predicted(
        self,
        memory: ConvergingMemory,
        stem: StemState,
        observation: Observation,
        table: StictionTable,
        *,
        is_left: bool,
    ) -> tuple[Any, Decision]:
        """Return the predictive law's memory and decision; a stem that is left is where it should be."""
        seen = replace(observation, setpoint_m=stem.position_m) if is_left else observation
        return self.predictive.decide(memory.predictive, stem, seen, table)

    # -- the contract

    def _broken(self, memory: ConvergingMemory, dwell: Dwell, stem: StemState, setpoint_m: float) -> str:
        """Return how the predictive law has not kept the contract in this cycle, empty where it has."""
        before, percent = memory.dwell, 100.0 / self.span_m
        if before.aim_m is not None and dwell.misses > _MOST_MISSES:
            miss_m = abs(stem.position_m - before.aim_m)
            return f"a move of {before.way_m * percent:.2f} % of span ended {miss_m * percent:.2f} % off"
        if memory.astray_s > _ASTRAY_S:
            return f"readings {abs(memory.astray_m) * percent:.2f} % of span from where the stem is believed to be"
        if dwell.away_s > self.patience_s:
            off = abs(memory.smooth_m - setpoint_m) * percent
            return f"{off:.2f} % of span off for {dwell.away_s:.2f} s"
        return ""

    def _compared(self, memory: ConvergingMemory, stem: StemState, observation: Observation) -> ConvergingMemory:
        """Return the memory after the reading has been compared with what the predictive law believes."""
        elapsed_s = observation.elapsed_s
        astray_m = _smoothed_m(memory.astray_m, observation.measured_m - stem.position_m, elapsed_s)
        is_astray = abs(astray_m) > _MISS * self.span_m + _ASTRAY * self.quasi_static.judge.sigma_m(stem.position_m)
        return replace(memory, astray_m=astray_m, astray_s=memory.astray_s + elapsed_s if is_astray else 0.0)

    def _timed(self, memory: ConvergingMemory, stem: StemState, time_s: float) -> ConvergingMemory:
        """Return the memory with how long predictive moves last: from their begin until the stem has stopped."""
        if memory.begun_s is None or stem.stuck != memory.slid:  # it has not begun to slide yet, or still slides
            return memory
        if not memory.slid:
            return replace(memory, slid=True)
        return replace(memory, begun_s=None, slid=False, lasts_s=time_s - memory.begun_s)

    def _is_small(self, memory: ConvergingMemory, stem: StemState, setpoint_m: float) -> bool:
        """Return whether an error may be left: a larger one, once a move to this setpoint has been made."""
        dwell = memory.dwell
        has_moved = dwell.ended > 0 or dwell.aim_m is not None
        return abs(stem.position_m - setpoint_m) < (LEFT if has_moved else _SMALL) * self.span_m

    def _is_vain(
        self, memory: ConvergingMemory, dwell: Dwell, stem: StemState, setpoint_m: float, reason: MoveReason
    ) -> bool:
        """Return whether a correction costs more than it gains, or is not expected to halve the error."""
        error_m = abs(stem.position_m - setpoint_m)
        if not self._is_small(memory, stem, setpoint_m):
            return False
        if not pays(error_m, abs(reason.aim_m - setpoint_m), memory.lasts_s, dwell.ended + dwell.misses):
            return True
        return dwell.ended >= _ENOUGH and error_m < _HALVED * math.sqrt(dwell.missed_m2 / dwell.ended)

    def _followed(
        self, memory: ConvergingMemory, stem: StemState, observation: Observation, decision: Decision
    ) -> Dwell:
        """Return the dwell after this cycle: a move that ends is judged where the next one begins."""
        dwell = self._waited(memory, observation, counts=True)
        aim_m, way_m = dwell.aim_m, dwell.way_m
        ended, missed_m2, misses = dwell.ended, dwell.missed_m2, dwell.misses
        if decision.reason is not None:
            here_m, next_m = stem.position_m, decision.reason.aim_m
            miss_m = math.inf if aim_m is None else abs(here_m - aim_m)
            if _MISS * self.span_m < miss_m < math.inf:
                misses += 1
            elif _HALVED * miss_m < way_m:  # not a push in vain
                ended, missed_m2 = ended + 1, missed_m2 + miss_m * miss_m
            # a move that only backs off may end anywhere
            leads = abs(next_m - observation.setpoint_m) < _MISS * self.span_m
            aim_m, way_m = (next_m, abs(next_m - here_m)) if leads else (None, 0.0)
        return replace(dwell, aim_m=aim_m, way_m=way_m, ended=ended, missed_m2=missed_m2, misses=misses)

    def _waited(self, memory: ConvergingMemory, observation: Observation, *, counts: bool) -> Dwell:
        """Return the dwell after a cycle in which the stem may be away from its setpoint, if that `counts`."""
        dwell, elapsed_s = memory.dwell, observation.elapsed_s
        is_away = abs(memory.smooth_m - observation.setpoint_m) > LEFT * self.span_m
        return replace(
            dwell,
            left_m=dwell.left_m if dwell.left_m == observation.setpoint_m else None,
            away_s=dwell.away_s + elapsed_s if is_away and counts else 0.0,
            lost_s=dwell.lost_s + elapsed_s if is_away and memory.pause else 0.0,
        )

    def _told(self, memory: ConvergingMemory, decision: Decision) -> Decision:
        """Return the decision; the valve differs where quasi-static moves have measured it, or none has led for long.

        That predictive moves fail may be chance: noise, a setpoint that moves on, a load that has changed.
        """
        differs = memory.quasi_static.is_other or memory.dwell.lost_s > self.patience_s
        return replace(decision, differs=True) if differs else decision

    # -- who moves the stem

    def _leads(self, memory: ConvergingMemory) -> bool:
        """Return whether the configured model leads a predictive move to the setpoint, as far as has been measured."""
        if self.quasi_static_first:
            return False
        belief, here_m, setpoint_m = memory.quasi_static.belief, memory.smooth_m, memory.dwell.setpoint_m
        direction, miss_m = 1.0 if setpoint_m > here_m else -1.0, _MISS * self.span_m
        is_sure = belief.landing_sigma_m(setpoint_m, direction) <= miss_m
        is_other = memory.quasi_static.is_other
        return not is_other and is_sure and belief.beside_configured_m(here_m, setpoint_m, direction) < miss_m

    def _at_new_setpoint(self, memory: ConvergingMemory, setpoint_m: float) -> ConvergingMemory:
        """Return the memory at another setpoint: what the last dwell says of the predictive law."""
        dwell, pause, left = memory.dwell, memory.pause, memory.left
        left = max(left - 1, 0)
        is_good = abs(memory.smooth_m - dwell.setpoint_m) < _GOOD * self.span_m and not dwell.misses
        if memory.acting is Acting.PREDICTIVE and is_good:
            pause = 0
        acting = Acting.QUASI_STATIC if memory.acting is Acting.QUASI_STATIC else Acting.PREDICTIVE
        return replace(memory, acting=acting, dwell=Dwell(setpoint_m), pause=pause, left=left)

    def _failed(self, memory: ConvergingMemory, setpoint_m: float) -> ConvergingMemory:
        """Return the memory after a failure; one where the configured valve cannot go says nothing of the law."""
        low_m, high_m = self.reach_m
        if not low_m <= setpoint_m <= high_m:
            return memory
        pause = min(max(2 * memory.pause, _FIRST_PAUSE), _LONGEST_PAUSE)
        return replace(memory, pause=pause, left=pause + 1)

    def _quasi_static_begins(
        self, memory: ConvergingMemory, observation: Observation, table: StictionTable
    ) -> tuple[ConvergingMemory, Decision]:
        before = self.quasi_static.resumed(memory.quasi_static, memory.smooth_m)
        quasi_static, estimate = self.quasi_static.estimate(before, observation)
        quasi_static, decision = self.quasi_static.decide(quasi_static, estimate.stem, observation, table)
        memory = replace(
            memory,
            acting=Acting.QUASI_STATIC,
            quasi_static=quasi_static,
            dwell=Dwell(observation.setpoint_m),
            taken_over_m=memory.smooth_m,
            astray_m=0.0,
            astray_s=0.0,
            begun_s=None,
        )
        return memory, self._told(memory, decision)

    def _predictive_begins(
        self, memory: ConvergingMemory, acting: Acting, observation: Observation, table: StictionTable
    ) -> tuple[ConvergingMemory, Decision]:
        """Return the memory and decision of the predictive law; at the same setpoint, pushes in vain still count."""
        predictive = memory.predictive
        has_moved = abs(memory.smooth_m - memory.taken_over_m) > LEFT * self.span_m
        if acting is Acting.PREDICTIVE or has_moved:
            predictive = self.predictive.begin(observation.measured_m)
        predictive, estimate = self.predictive.estimate(predictive, observation)
        predictive, decision = self.predictive.decide(predictive, estimate.stem, observation, table)
        return replace(memory, acting=acting, predictive=predictive), self._told(memory, decision)


def _smoothed_m(before_m: float, now_m: float, elapsed_s: float) -> float:
    return before_m + min(1.0, elapsed_s / _SMOOTHING_S) * (now_m - before_m)


def converging_law(
    name: str,
    predictive: Law[Any],
    quasi_static: QuasiStaticLaw,
    valve: ValveParameters,
    period_s: float,
    rate_ma_per_s: float,
) -> ConvergingLaw:
    """Return the law of a valve whose readings show at once what a current does.

    Args:
        name: of the law in a configuration.
        predictive: moves the stem while it keeps the contract.
        quasi_static: moves it where the other one does not.
        valve: as configured.
        period_s: of the readings.
        rate_ma_per_s: limit of the command's change, 0 is none.
    """
    patience_s = _REST_S + _LAGS * (valve.lag_s + period_s) + (_SIGNAL_MA / rate_ma_per_s if rate_ma_per_s else 0.0)
    reach_m = valve.reach_m(quasi_static.limits.low_ma, quasi_static.limits.high_ma)
    first = period_s > _COARSE * math.sqrt(valve.mass_kg / valve.spring_rate_n_per_m)
    quasi_static = replace(quasi_static, keeps=first)  # else predictive moves teach the table
    return ConvergingLaw(name, predictive, quasi_static, valve.span_m, patience_s, reach_m, first)
