"""The law `nmpc`: it moves the stem as fast as it can still be stopped, then waits. Pure, but for the solver inside.

    REST    the stem rests in the middle of its stick band; readings are averaged until an error is certain
    MOVE    Γ frees the stem, then the LTV-QP of `plan` takes it to the setpoint
    SETTLE  the model says that the stem has stopped: the middle of the stick band for some milliseconds, then REST

The place where the stem comes to rest corrects the estimate of spring and friction. Whether a push freed the stem
corrects Γ. The stiction table keeps both, and the law reads them from it after a restart.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.laws.bounds import Bounds
from positioner.laws.estimator_settings import measurement_sigma_m
from positioner.laws.law import Decision
from positioner.laws.move_reason import MoveReason
from positioner.laws.nmpc.breakaway import load_from_table
from positioner.laws.nmpc.departure import Departing
from positioner.laws.nmpc.filter import Resting, Sliding, as_one_more_m2, average, believed_m, taught
from positioner.laws.nmpc.landing import Landing
from positioner.laws.nmpc.late_commands import ahead, is_push_late, still_resting, with_current_of_rest, with_lateness
from positioner.laws.nmpc.memory import NmpcMemory, report, with_resolution
from positioner.laws.nmpc.move import move_of
from positioner.laws.nmpc.plan import plan_move
from positioner.laws.nmpc.rest import update_at_rest, without_trial
from positioner.laws.nmpc.verification import RestMonitor, Verification
from positioner.values import dataclass, replace
from positioner.valve.stiction import LearnedSample, Quantity, StictionTable, direction_of
from positioner.wire.messages import Motion

if TYPE_CHECKING:
    from positioner.laws.estimator_settings import EstimatorSettings
    from positioner.laws.law import Estimate, Observation
    from positioner.laws.nmpc.filter import AdaptiveFilter
    from positioner.laws.nmpc.move import Move
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
    command_delay_s: float
    table_from_s: float
    table_cell_m: float

    @property
    def longest_move_s(self) -> float:
        """The longest time in s that a move can take; a stem that slides longer in the model has stopped in fact."""
        return 3.0 + 10.0 * self.valve.viscous_friction_n_s_per_m / self.valve.spring_rate_n_per_m

    def begin(self, measured_m: float) -> NmpcMemory:
        """Return the memory of a stem that rests somewhere; the first `estimate` uses the reading."""
        nominal = self.filter.nominal
        stem = self.filter.at_rest(
            measured_m, self.valve.span_m * self.valve.span_m, nominal, self.filter.prior_sigmas()
        )
        ratio = self.valve.static_friction_n / nominal.friction_n if nominal.friction_n else 1.0
        return NmpcMemory(stem, RestMonitor(ratio))

    def estimate(self, memory: NmpcMemory, observation: Observation) -> tuple[NmpcMemory, Estimate]:
        """Return the memory and the stem after this cycle's reading: a Kalman filter in motion, an average at rest."""
        memory = with_lateness(memory, observation)
        stem = memory.stem
        # the place where a rest began: readings of one rest are compared in one unit
        place_m = stem.anchor.x if isinstance(stem, Resting) else stem.x
        sigma_m = measurement_sigma_m(self.estimator, self.valve, place_m)
        monitor, measured_m = memory.monitor, observation.measured_m
        variance_m2 = monitor.noise.averaged_m2(sigma_m)
        noise_m2 = monitor.noise.of_reading * sigma_m * sigma_m
        if monitor.resolution.last_m is None:
            variance_m2 = noise_m2  # nothing came before the first reading that it could remember
        hidden_m2 = monitor.resolution.hidden_m2(noise_m2)
        memory = with_resolution(memory, measured_m)
        if isinstance(stem, Sliding):
            if is_push_late(memory, stem, observation):
                return still_resting(self.filter, memory, stem, observation, variance_m2)
            return self._track(memory, stem, observation, variance_m2 + hidden_m2, noise_m2 + hidden_m2)
        if memory.motion is Motion.REST:
            own, cell_m = self.settings, self.table_cell_m
            return update_at_rest(own, self.filter, cell_m, memory, stem, observation, variance_m2, sigma_m)
        variance_m2 = as_one_more_m2(stem, variance_m2, hidden_m2)
        after = average(stem, believed_m(stem.x, stem.variance_m2, measured_m, noise_m2 + hidden_m2), variance_m2)
        left_s = memory.settle_s - observation.elapsed_s
        motion = Motion.SETTLE if left_s > _INSTANT_S else Motion.REST
        return replace(memory, stem=after, settle_s=left_s, motion=motion), report(after)

    def decide(
        self, memory: NmpcMemory, stem: StemState, observation: Observation, table: StictionTable
    ) -> tuple[NmpcMemory, Decision]:
        """Return the memory, and the decision: to hold the stem, to free it, or to follow the plan."""
        if observation.time_s < self.table_from_s:
            table = StictionTable(table.cell_width_m)
        if memory.setpoint_m is None:
            memory = self._with_load_of_table(memory, table)
        if observation.setpoint_m != memory.setpoint_m:
            wanted_m = observation.setpoint_m
            pushes = memory.pushes.for_setpoint(wanted_m, self.valve.span_m)
            is_new = memory.setpoint_m is not None
            memory = replace(memory, setpoint_m=wanted_m, is_new=is_new, aim_m=wanted_m, corrections=0, pushes=pushes)
        here, setpoint_m = memory.stem, observation.setpoint_m
        if isinstance(here, Sliding):
            soon = ahead(self.filter, memory, here, observation, self.period_s)
            if soon.stopped:
                return memory, self._held(soon.load.spring_n_per_m * soon.x, Motion.MOVE)
            return memory, self._follow(self._move(memory, soon, memory.aim_m))
        pushes = memory.pushes
        if pushes.unreported:
            memory = replace(memory, pushes=replace(pushes, unreported=False))
        may = pushes.may_push(observation.time_s) or pushes.has_moved(here.x, here.sigma_m)
        # a first command that acts later, or late, must be one that holds the stem: no echo can tell yet what acts
        may = may and (memory.hold_ma is not None or not self.command_delay_s)
        if stem.stuck and may and memory.motion is Motion.REST and self._is_worth_a_move(memory, here, setpoint_m):
            memory, begin = without_trial(self.settings.watch, memory, here, observation.time_s)
            memory, decision = self._start(memory, begin, observation, table)
        else:
            memory, decision = self._rest(memory, here)
        if memory.is_new and memory.motion is not Motion.SETTLE:
            memory = replace(memory, is_new=False)
        if pushes.unreported:
            decision = replace(decision, failed_pushes=pushes.failed, rest_s=pushes.rest_s)
        return memory, decision

    def _track(
        self, memory: NmpcMemory, stem: Sliding, observation: Observation, variance_m2: float, noise_m2: float
    ) -> tuple[NmpcMemory, Estimate]:
        """Return the memory and the sliding stem; when the model or the reading has stopped it, it settles."""
        ahead = self.filter.advance(stem, observation.applied_ma, observation.elapsed_s)
        here_m = observation.measured_m
        if self.command_delay_s:  # the estimate is for the instant at which this cycle's command acts
            at_reading_s = max(observation.elapsed_s - self.command_delay_s, 0.0)
            here_m += self.filter.moved_m(stem, ahead, observation.applied_ma, at_reading_s)
        here_m = believed_m(ahead.x, ahead.covariance.xx, here_m, noise_m2)
        after = self.filter.correct(ahead, here_m, variance_m2)
        overdue = observation.time_s > memory.ends_s
        if not after.stopped and not overdue:
            return replace(memory, stem=after), report(after)
        rest = self.filter.rest(after)
        monitor, landing = memory.monitor.at_new_place(), memory.monitor.landing
        if landing is not None and not landing.is_planned(rest):
            monitor = replace(monitor, landing=None)
        if monitor.verification is not None and not overdue:
            stop = LearnedSample(Quantity.STICK_SPEED, rest.x, direction_of(stem.direction), abs(stem.v))
            monitor = replace(monitor, verification=replace(monitor.verification, stop=stop))
        settle_s = self.settings.settle_s
        memory = replace(memory, stem=rest, monitor=monitor, motion=Motion.SETTLE, settle_s=settle_s, hold_ma=None)
        return memory, report(rest)

    def _with_load_of_table(self, memory: NmpcMemory, table: StictionTable) -> NmpcMemory:
        """Return the memory with K and friction from the table, so that a restart does not change the law."""
        stem, sigmas = memory.stem, self.filter.prior_sigmas()
        assert isinstance(stem, Resting)  # noqa: S101 - control begins at rest
        load, sigmas = load_from_table(
            self.settings.breakaway, self.filter.model, table, self.filter.nominal, sigmas, memory.monitor.ratio
        )
        return replace(memory, stem=self.filter.at_rest(stem.x, stem.variance_m2, load, sigmas))

    def _is_worth_a_move(self, memory: NmpcMemory, here: Resting, setpoint_m: float) -> bool:
        """Whether the error is probably beyond the tolerance: a new setpoint is worth a move sooner than a correction.

        While it is open whether the move before has happened, a correction must be right in both cases.
        """
        own, error_m, tried = self.settings, setpoint_m - here.x, memory.monitor.verification
        patience = 1.0 + own.patience * min(memory.corrections, own.patience_limit)
        doubt_sigma = own.doubt_sigma if memory.corrections else own.doubt_sigma_unasked
        if memory.is_new:
            doubt_sigma = own.doubt_sigma_first
        if abs(error_m) <= patience * (own.tolerance_m + doubt_sigma * here.sigma_m):
            return False
        if tried is None or not memory.corrections:
            return True
        origin, s = tried.origin, math.copysign(1.0, error_m)
        # two places far apart are soon told apart
        is_near = abs(here.x - origin.x) < _NEAR * abs(error_m)
        return is_near and s * (setpoint_m - origin.x) > patience * (own.tolerance_m + doubt_sigma * origin.sigma_m)

    def _rest(self, memory: NmpcMemory, here: Resting) -> tuple[NmpcMemory, Decision]:
        """Return the middle of the stick band; the current follows it in steps only."""
        decision, held_ma = self._held(here.spring_n_per_m * here.x, memory.motion), memory.hold_ma
        if held_ma is not None and abs(decision.current_ma - held_ma) <= self.settings.hold_step_ma:
            return memory, replace(decision, current_ma=held_ma)
        return replace(memory, hold_ma=decision.current_ma), decision

    def _held(self, spring_n: float, motion: Motion) -> Decision:
        """Return the middle of the stick band where the spring has this force."""
        middle_ma = min(max(self.filter.model.current_ma(spring_n), self.current_low_ma), self.current_high_ma)
        return Decision(middle_ma, Bounds(0.0, 0.0, self.current_low_ma, self.current_high_ma), motion)

    def _start(
        self, memory: NmpcMemory, here: Resting, observation: Observation, table: StictionTable
    ) -> tuple[NmpcMemory, Decision]:
        """Return the first current of a move, at least Γ, for one sample (eqs 25, 26; D8)."""
        monitor, setpoint_m = memory.monitor, observation.setpoint_m
        monitor = replace(monitor, repeatability=monitor.repeatability.followed_by(here))
        limits_ma = (self.current_low_ma, self.current_high_ma)
        departing = Departing(self.settings, self.filter, limits_ma, self.period_s, monitor.repeatability.factor)
        begun, fallback = departing.to(here, setpoint_m, monitor.ratio, table), ""
        if not begun.frees:
            low_ma, high_ma = limits_ma
            fallback = (
                f"breakaway takes {begun.gamma.current_ma:.2f} mA, outside {low_ma:g} to {high_ma:g} mA: full push"
            )
        sliding, aim_m, direction = begun.sliding, begun.aim_m, begun.sliding.direction
        decision = self._follow(begun.move)
        at_limit = direction * (decision.current_ma - begun.release_ma) <= _SAME_MA
        verification = Verification(taught(here), direction, at_limit, aim_m - here.x, was_expected=begun.frees)
        monitor = replace(monitor, verification=verification, landing=Landing(here.x, aim_m, direction))
        ends_s, count = observation.time_s + self.longest_move_s, memory.corrections + 1
        memory = replace(memory, stem=sliding, motion=Motion.MOVE, aim_m=aim_m, monitor=monitor, ends_s=ends_s)
        memory = replace(with_current_of_rest(memory, observation), corrections=count)
        reason = MoveReason(setpoint_m - here.x, begun.gamma, aim_m)
        return memory, replace(decision, reason=reason, fallback=fallback or decision.fallback)

    def _move(self, memory: NmpcMemory, here: Sliding, aim_m: float, release_ma: float | None = None) -> Move:
        """Return the move from `here` to the aim; `release_ma` is Γ while the stem still sticks."""
        static_n = memory.monitor.ratio * here.load.friction_n
        limits_ma = (self.current_low_ma, self.current_high_ma)
        return move_of(self.settings, self.filter.model, here, aim_m, static_n, limits_ma, release_ma)

    def _follow(self, move: Move) -> Decision:
        """Return the first current of the plan for `move`."""
        found = plan_move(self.settings.approach, self.filter.model, self.solver, move, self.period_s)
        low_ma, high_ma = sorted((move.release_ma, move.strongest_ma))
        limit = found.speed_limit_m_per_s
        speeds = (0.0, limit) if move.direction > 0.0 else (limit, 0.0)
        fallback = "" if found.is_solved else "no plan: the fastest inputs that keep the bound"
        return Decision(
            found.inputs_ma[0], Bounds(*speeds, low_ma, high_ma), Motion.MOVE, passes=found.passes, fallback=fallback
        )


_NEAR = 0.5
"""Two possible places of the stem are near each other within this part of the error."""
_INSTANT_S = 1e-9
"""Rounding of a sum of periods."""
_SAME_MA = 0.05
"""Currents that differ by less push equally hard."""
