"""The law `nmpc`: as fast as the stem can still stop, and then patience. Pure, but for the solver inside.

    HOLD    the stem rests in the middle of its stick band; readings are averaged until an error is beyond doubt
    MOVE    Γ frees the stem, then the LTV-QP of `nmpc_plan` takes it to the setpoint
    SETTLE  the model says it has stopped: the middle of the stick band for some milliseconds, then HOLD

Where the stem comes to rest corrects what the filter believes of spring and friction; whether a push freed it corrects
Γ. Both go into the stiction table, and from the table they come back after a restart.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from positioner.laws.bounds import Bounds
from positioner.laws.estimator_settings import measurement_sigma_m
from positioner.laws.law import Decision
from positioner.laws.move_reason import MoveReason
from positioner.laws.nmpc.breakaway import breakaway, recollect
from positioner.laws.nmpc.filter import Resting, Sliding, average
from positioner.laws.nmpc.landing import Landing, landing_bias_m
from positioner.laws.nmpc.memory import NmpcMemory, report
from positioner.laws.nmpc.plan import Course, approach
from positioner.laws.nmpc.rest import attend
from positioner.laws.nmpc.verification import Trial, Watch
from positioner.valve.stiction import LearnedSample, Quantity, StictionTable, direction_of
from positioner.wire.messages import Motion

if TYPE_CHECKING:
    from positioner.laws.estimator_settings import EstimatorSettings
    from positioner.laws.law import Estimate, Observation
    from positioner.laws.nmpc.filter import AdaptiveFilter
    from positioner.laws.nmpc.settings import NmpcSettings
    from positioner.optimization.qp import Solver
    from positioner.valve.parameters import ValveParameters
    from positioner.valve.state import StemState


@dataclass(frozen=True, slots=True)
class NmpcLaw:
    """The law; `solver` takes H_u variables and H_u + H_p rows."""

    name: str
    valve: ValveParameters
    settings: NmpcSettings
    estimator: EstimatorSettings
    filter: AdaptiveFilter
    solver: Solver
    current_low_ma: float
    current_high_ma: float
    period_s: float
    table_from_s: float
    table_cell_m: float

    @property
    def longest_move_s(self) -> float:
        """How long a move can take in s: the model of a stem that does not stop, and does not move, is wrong."""
        return 3.0 + 10.0 * self.valve.viscous_friction_n_s_per_m / self.valve.spring_rate_n_per_m

    def begin(self, measured_m: float) -> NmpcMemory:
        """Return the memory of a stem that rests somewhere; the first `estimate` takes in the reading itself."""
        nominal = self.filter.nominal
        stem = self.filter.at_rest(measured_m, self.valve.span_m**2, nominal, self.filter.prior_sigmas())
        ratio = self.valve.static_friction_n / nominal.friction_n if nominal.friction_n else 1.0
        return NmpcMemory(stem, Watch(ratio))

    def estimate(self, memory: NmpcMemory, observation: Observation) -> tuple[NmpcMemory, Estimate]:
        """Return the memory and the stem after this cycle's reading: a Kalman filter in motion, an average at rest."""
        stem = memory.stem
        sigma_m = measurement_sigma_m(self.estimator, self.valve, stem.x)
        variance_m2 = max(memory.watch.noise.ratio, _LEAST_NOISE) * sigma_m * sigma_m
        if isinstance(stem, Sliding):
            return self._track(memory, stem, observation, variance_m2)
        after = average(stem, observation.measured_m, variance_m2)
        if memory.motion is Motion.REST:
            own, seen = self.settings, (stem, after)
            return attend(own, self.filter, self.table_cell_m, memory, seen, observation, variance_m2, sigma_m)
        left_s = memory.settle_s - observation.elapsed_s
        motion = Motion.SETTLE if left_s > _INSTANT_S else Motion.REST
        return replace(memory, stem=after, settle_s=left_s, motion=motion), report(after)

    def decide(
        self, memory: NmpcMemory, stem: StemState, observation: Observation, table: StictionTable
    ) -> tuple[NmpcMemory, Decision]:
        """Return the current that holds the stem, that frees it, or that the plan begins with."""
        if observation.time_s < self.table_from_s:
            table = StictionTable(table.cell_width_m)
        if memory.setpoint_m is None:
            memory = self._recalled(memory, table)
        if observation.setpoint_m != memory.setpoint_m:
            memory = replace(
                memory,
                setpoint_m=observation.setpoint_m,
                aim_m=observation.setpoint_m,
                corrections=0,
                pushes=memory.pushes.pursuing(observation.setpoint_m, self.valve.span_m),
            )
        here, setpoint_m = memory.stem, observation.setpoint_m
        if isinstance(here, Sliding):
            course = self._course(memory, here, memory.aim_m)
            return self._follow(memory, course, memory.plan_ma)
        told = memory.pushes
        if told.untold:
            memory = replace(memory, pushes=replace(told, untold=False))
        may = told.may_push(observation.time_s) or told.has_moved(here.x, here.sigma_m)
        if stem.stuck and may and memory.motion is Motion.REST and self._is_worth_a_move(memory, here, setpoint_m):
            memory, decision = self._start(memory, here, observation, table)
        else:
            memory, decision = self._hold(memory, here)
        if told.untold:
            decision = replace(decision, failed_pushes=told.failed, rest_s=told.rest_s)
        return memory, decision

    def _track(
        self, memory: NmpcMemory, stem: Sliding, observation: Observation, variance_m2: float
    ) -> tuple[NmpcMemory, Estimate]:
        """Return the memory and the sliding stem; when the model or the reading has stopped it, it settles."""
        ahead = self.filter.advance(stem, observation.applied_ma, observation.elapsed_s)
        after = self.filter.correct(ahead, observation.measured_m, variance_m2)
        overdue = observation.time_s > memory.ends_s
        if not after.stopped and not overdue:
            return replace(memory, stem=after), report(after)
        rest = self.filter.rest(after)
        seen, landing = memory.watch.elsewhere(), memory.watch.landing
        if landing is not None and not landing.is_planned(rest):
            seen = replace(seen, landing=None)
        if seen.trial is not None and not overdue:
            stop = LearnedSample(Quantity.STICK_SPEED, rest.x, direction_of(stem.direction), abs(stem.v))
            seen = replace(seen, trial=replace(seen.trial, stop=stop))
        memory = replace(
            memory,
            stem=rest,
            watch=seen,
            motion=Motion.SETTLE,
            settle_s=self.settings.settle_s,
            hold_ma=None,
        )
        return memory, report(rest)

    def _recalled(self, memory: NmpcMemory, table: StictionTable) -> NmpcMemory:
        """Return the memory with what the table remembers of K and F_s: after a restart the law is what it was."""
        stem, sigmas = memory.stem, self.filter.prior_sigmas()
        assert isinstance(stem, Resting)  # noqa: S101 - control begins at rest
        load, sigmas = recollect(
            self.settings.breakaway, self.filter.model, table, self.filter.nominal, sigmas, memory.watch.ratio
        )
        return replace(memory, stem=self.filter.at_rest(stem.x, stem.variance_m2, load, sigmas))

    def _is_worth_a_move(self, memory: NmpcMemory, here: Resting, setpoint_m: float) -> bool:
        """Whether the error is beyond tolerance and doubt. A trial is waited for, but not with a new setpoint."""
        own = self.settings
        if memory.corrections and memory.watch.trial is not None:
            return False
        tolerance_m = own.tolerance_m * (1.0 + own.patience * min(memory.corrections, own.patience_limit))
        return abs(setpoint_m - here.x) > tolerance_m + own.doubt_sigma * here.sigma_m

    def _hold(self, memory: NmpcMemory, here: Resting) -> tuple[NmpcMemory, Decision]:
        """Return the middle of the stick band, followed in steps only."""
        middle_ma = self._clamp(self.filter.model.current_ma(here.load.spring_n_per_m * here.x))
        held_ma = memory.hold_ma
        if held_ma is None or abs(middle_ma - held_ma) > self.settings.hold_step_ma:
            memory, held_ma = replace(memory, hold_ma=middle_ma), middle_ma
        bounds = Bounds(0.0, 0.0, self.current_low_ma, self.current_high_ma)
        return memory, Decision(held_ma, bounds, memory.motion)

    def _start(
        self, memory: NmpcMemory, here: Resting, observation: Observation, table: StictionTable
    ) -> tuple[NmpcMemory, Decision]:
        """Return the first current of a move, at least Γ, for one sample (eqs 25, 26; D8).

        Γ beyond the loop is an estimate, so it is tried. The stem stays where the smallest push would carry it too far
        past.
        """
        setpoint_m = observation.setpoint_m
        error_m = setpoint_m - here.x
        direction = math.copysign(1.0, error_m)
        model, (spring, friction_n, _) = self.filter.model, here.load
        static_n = memory.watch.ratio * friction_n
        gamma = breakaway(self.settings.breakaway, model, table, here.x, direction, spring, static_n)
        release_ma = self._clamp(gamma.current_ma)
        fallback = ""
        if direction * (gamma.current_ma - release_ma) > 0.0:
            fallback = f"breakaway takes {gamma.current_ma:.2f} mA, more than the loop can give: full push"
        aim_m = setpoint_m - landing_bias_m(table, setpoint_m, direction)
        sliding = self.filter.depart(here, direction)
        course = self._course(memory, sliding, aim_m, release_ma)
        if direction * (course.smallest_m(model, self.period_s) - setpoint_m) >= abs(error_m):
            return self._hold(memory, here)
        memory = replace(memory, stem=sliding, motion=Motion.MOVE, aim_m=aim_m, corrections=memory.corrections + 1)
        memory, decision = self._follow(memory, course, ())
        at_limit = direction * (decision.current_ma - release_ma) <= _SAME_MA
        landing = Landing(here.x, aim_m, direction)
        on_trial = replace(memory.watch, trial=Trial(here, direction, at_limit, aim_m - here.x), landing=landing)
        memory = replace(memory, watch=on_trial, ends_s=observation.time_s + self.longest_move_s)
        return memory, replace(decision, reason=MoveReason(error_m, gamma), fallback=fallback or decision.fallback)

    def _course(self, memory: NmpcMemory, here: Sliding, aim_m: float, release_ma: float | None = None) -> Course:
        """Return what the plan is asked for; `release_ma` is Γ while the stem still sticks."""
        s, (spring, friction_n, _), model = here.direction, here.load, self.filter.model
        # an aim that has come to lie behind is for the next move: this one stops where it can
        target_m = aim_m if s * (aim_m - here.x) > 0.0 else here.x
        middle_n, static_n = spring * target_m, memory.watch.ratio * friction_n
        brake_ma = self._clamp(model.current_ma(middle_n - s * self.settings.brake_share * static_n))
        weakest_ma = self._clamp(model.current_ma(middle_n - s * self.settings.brake_limit * friction_n))
        strongest_ma = self.current_high_ma if s > 0.0 else self.current_low_ma
        first_ma = weakest_ma if release_ma is None else s * max(s * release_ma, s * weakest_ma)
        return Course(here.x, here.v, s, target_m, here.load, brake_ma, weakest_ma, strongest_ma, first_ma)

    def _follow(self, memory: NmpcMemory, course: Course, plan_ma: tuple[float, ...]) -> tuple[NmpcMemory, Decision]:
        """Return the first current of the plan for `course`; without a solution the last plan goes on."""
        own = self.settings.approach
        guess_ma = plan_ma or (course.release_ma, *(course.brake_ma,) * (own.control_steps - 1))
        found = approach(own, self.filter.model, self.solver, course, guess_ma, self.period_s)
        low_ma, high_ma = sorted((course.release_ma, course.strongest_ma))
        if found is None:
            bounds = Bounds(-math.inf, math.inf, low_ma, high_ma)
            first_ma = min(max(guess_ma[0], low_ma), high_ma)
            memory = replace(memory, plan_ma=(*guess_ma[1:], course.brake_ma))
            return memory, Decision(first_ma, bounds, Motion.MOVE, fallback="no plan: the last one goes on")
        limit = found.speed_limit_m_per_s
        speeds = (0.0, limit) if course.direction > 0.0 else (limit, 0.0)
        memory = replace(memory, plan_ma=(*found.inputs_ma[1:], found.inputs_ma[-1]))
        return memory, Decision(found.inputs_ma[0], Bounds(*speeds, low_ma, high_ma), Motion.MOVE, passes=found.passes)

    def _clamp(self, current_ma: float) -> float:
        return min(max(current_ma, self.current_low_ma), self.current_high_ma)


_LEAST_NOISE = 1e-6
"""Of the configured variance: less is never believed of a sensor."""
_INSTANT_S = 1e-9
"""Rounding of a sum of periods."""
_SAME_MA = 0.05
"""Currents closer than this push alike."""
