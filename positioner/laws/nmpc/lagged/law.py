"""The law `nmpc` on a valve whose pressure follows the current with a lag. Pure.

    REST    the stem rests in the middle of its stick band; readings are averaged until an error is certain
    RAMP    the pressure rises until the readings show that the stem has slipped, and when
    SLIP    the current stops it at the target, by the predicted stop
    SETTLE  the model says that it has stopped: the middle of the stick band for some milliseconds, then REST

Every slip teaches K, F_s and the lag (`regression`), every landing how far beside its aim a move ends.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.laws.bounds import Bounds
from positioner.laws.estimator_settings import measurement_sigma_m
from positioner.laws.law import Decision, Estimate
from positioner.laws.nmpc.breakaway import breakaway_lesson, load_from_table
from positioner.laws.nmpc.lagged import ramping, sliding
from positioner.laws.nmpc.lagged.kept import fit_of, with_fit
from positioner.laws.nmpc.lagged.measuring import with_pressure
from positioner.laws.nmpc.lagged.memory import LaggedMemory, Ramp, Slipping
from positioner.laws.nmpc.lagged.pipeline import pipeline_at
from positioner.laws.nmpc.lagged.rest import LaggedRest
from positioner.laws.nmpc.lagged.resting import considered
from positioner.laws.nmpc.lagged.setpoint import with_setpoint
from positioner.values import dataclass, replace
from positioner.valve.motion import Load, MotionModel
from positioner.valve.state import StemState
from positioner.valve.stiction import StictionTable
from positioner.wire.messages import Motion

if TYPE_CHECKING:
    from positioner.laws.estimator_settings import EstimatorSettings
    from positioner.laws.law import Observation
    from positioner.laws.nmpc.lagged.valve import LaggedValve
    from positioner.laws.nmpc.settings import NmpcSettings
    from positioner.valve.parameters import ValveParameters
    from positioner.valve.stiction import LearnedSample


@dataclass(frozen=True, slots=True)
class LaggedLaw:
    """The law; `lagged` has its constants."""

    name: str
    valve: ValveParameters
    settings: NmpcSettings
    estimator: EstimatorSettings
    lagged: LaggedValve
    table_from_s: float
    table_cell_m: float

    def begin(self, measured_m: float) -> LaggedMemory:
        """Return the memory of a stem that rests somewhere, with the pressure that balances the spring."""
        own, span_m = self.lagged, self.valve.span_m
        drive = own.drive
        balance_ma = self.valve.balance_current_ma(measured_m)
        doubt_ma = own.static_n / own.model.gain_n_per_ma * _EVEN_SIGMA
        return LaggedMemory(
            LaggedRest(measured_m, span_m * span_m),
            pipeline_at(balance_ma, doubt_ma, own.dead_time_s, own.period_s),
            drive,
            own.prior(own.spring_n_per_m, own.static_n, own.sliding_n),
        )

    def estimate(self, memory: LaggedMemory, observation: Observation) -> tuple[LaggedMemory, Estimate]:
        """Return the memory and the stem after this cycle's reading."""
        own, was_sliding = self.lagged, isinstance(memory.stem, Slipping)
        variance_m2 = self._variance_m2(memory)
        sigma_m = math.sqrt(variance_m2)
        for _ in range(max(round(observation.elapsed_s / own.period_s), 1)):
            memory = self._later(memory, observation.applied_ma, sigma_m)
        if observation.pressure_is_new and observation.pressure_pa is not None:
            memory = with_pressure(own, memory, observation.pressure_pa / self.valve.pressure_gain_pa_per_ma)
        measured_m, time_s = observation.measured_m, observation.time_s
        stem = memory.stem
        if isinstance(stem, LaggedRest):
            configured_m = measurement_sigma_m(self.estimator, self.valve, stem.x)
            if stem.settle_s <= _INSTANT_S and abs(stem.gap) < 0.1 * sigma_m:
                memory = replace(memory, noise=memory.noise.followed_by(measured_m / configured_m))
            memory = replace(memory, stem=stem.averaged(measured_m, variance_m2))
        elif isinstance(stem, Ramp):
            memory = ramping.read(own, memory, stem, measured_m, variance_m2, time_s)
        else:
            memory = sliding.read(own, memory, stem, measured_m, variance_m2, time_s)
        lessons: tuple[LearnedSample, ...] = ()
        if isinstance(memory.stem, Slipping) and not was_sliding:
            lessons = (self._breakaway_lesson(memory, memory.stem),)
        return memory, Estimate(self._reported(memory), lessons)

    def decide(
        self, memory: LaggedMemory, stem: StemState, observation: Observation, table: StictionTable
    ) -> tuple[LaggedMemory, Decision]:
        """Return the memory, and the decision: to hold the stem, to raise the pressure, or to stop the stem."""
        del stem
        if memory.setpoint_m is None:
            if observation.time_s < self.table_from_s:
                table = StictionTable(table.cell_width_m)
            memory = self._with_load_of_table(memory, table)
        memory = with_setpoint(
            memory,
            observation.setpoint_m,
            self.lagged.tolerance_m(math.sqrt(self._variance_m2(memory))),
            self.valve.span_m,
        )
        reason = None
        if isinstance(memory.stem, LaggedRest):
            sigma_m = math.sqrt(self._variance_m2(memory))
            memory, reason = considered(self.lagged, memory, memory.stem, observation, sigma_m)
        current = memory.stem
        if isinstance(current, Ramp):
            ramp, current_ma = ramping.command(self.lagged, memory, current)
            memory = replace(memory, stem=ramp, hold_ma=None)
            if ramping.is_hopeless(ramp, memory.pipeline, memory.drive, current_ma, observation.time_s):
                x, variance_m2 = ramp.rest.x, ramp.rest.xx
                memory = ramping.given_up(memory, ramp, x, variance_m2, observation.time_s)
        elif isinstance(current, Slipping):
            current_ma = sliding.command(self.lagged, memory, current)
            memory = replace(memory, hold_ma=None)
        if isinstance(memory.stem, LaggedRest):
            memory, current_ma = self._held(memory, memory.stem)
        pushes = memory.pushes
        failed, rest_s = (pushes.failed, pushes.rest_s) if pushes.unreported else (0, 0.0)
        if pushes.unreported:
            memory = replace(memory, pushes=replace(pushes, unreported=False))
        notice = memory.notice
        if notice:
            memory = replace(memory, notice="")
        drive = self.lagged.drive
        bounds = Bounds(0.0, 0.0, drive.low_ma, drive.high_ma)
        motion = self._motion(memory)
        return memory, Decision(
            current_ma, bounds, motion, fallback=notice, reason=reason, failed_pushes=failed, rest_s=rest_s
        )

    def _later(self, memory: LaggedMemory, current_ma: float, sigma_m: float) -> LaggedMemory:
        """Return the memory one sample later, in which `current_ma` acted."""
        own, before, stem = self.lagged, memory.pipeline, memory.stem
        after = before.after(memory.drive, current_ma)
        if memory.measured is not None:
            measured = memory.measured.later(memory.drive, before.pressure_ma, after.pressure_ma)
            memory = replace(memory, measured=measured)
        if isinstance(stem, LaggedRest):
            later: LaggedRest | Ramp = stem.later(own.sensor, own.period_s)
        elif isinstance(stem, Ramp):
            later = ramping.later(own, memory, stem, before, after)
        else:
            return sliding.later(own, memory, stem, before, after, sigma_m)
        return replace(memory, stem=later, pipeline=after)

    def _variance_m2(self, memory: LaggedMemory) -> float:
        """Return the variance of a reading in m²: the configured one, corrected by what was learned at rest."""
        sigma_m = measurement_sigma_m(self.estimator, self.valve, self._reported(memory).position_m)
        return memory.noise.averaged_m2(sigma_m)

    def _reported(self, memory: LaggedMemory) -> StemState:
        stem = memory.stem
        if isinstance(stem, Slipping):
            return StemState(stem.state.x, stem.state.v, stuck=False, direction=stem.move.direction)
        if isinstance(stem, Ramp):
            return StemState(stem.rest.x, 0.0, stuck=True, direction=stem.move.direction)
        return StemState(stem.x, 0.0, stuck=True, direction=1.0)

    def _motion(self, memory: LaggedMemory) -> Motion:
        stem = memory.stem
        if isinstance(stem, LaggedRest):
            return Motion.SETTLE if stem.settle_s > _INSTANT_S else Motion.REST
        return Motion.MOVE

    def _breakaway_lesson(self, memory: LaggedMemory, slipping: Slipping) -> LearnedSample:
        """Return Γ for the table: the pressure that freed the stem."""
        model, move = MotionModel.of(self.valve), slipping.move
        spring_n_per_m = memory.belief.onsets.spring_n_per_m
        lesson = breakaway_lesson(
            model, self.table_cell_m, move.origin_m, move.direction, spring_n_per_m, slipping.static_n
        )
        return replace(lesson, fit=fit_of(memory))

    def _with_load_of_table(self, memory: LaggedMemory, table: StictionTable) -> LaggedMemory:
        """Return the memory with K and friction from the table, so that a restart does not change the law."""
        own, nominal = self.lagged, Load.of(self.valve)
        if table.fit is not None:
            return with_fit(own, memory, table.fit)
        if len(table) == 0:
            return memory
        ratio = own.static_n / nominal.friction_n if nominal.friction_n else 1.0
        doubt = own.settings.friction_doubt
        sigmas = Load(
            own.settings.spring_doubt * nominal.spring_n_per_m, doubt * nominal.friction_n, nominal.viscous_n_s_per_m
        )
        load, _ = load_from_table(self.settings.breakaway, MotionModel.of(self.valve), table, nominal, sigmas, ratio)
        return replace(memory, belief=own.prior(load.spring_n_per_m, ratio * load.friction_n, load.friction_n))

    def _held(self, memory: LaggedMemory, rest: LaggedRest) -> tuple[LaggedMemory, float]:
        """Return the middle of the stick band; the current follows it in steps only."""
        own = self.lagged
        middle_ma = own.drive.limited(own.model.pressure_ma(own.spring_n(memory.belief, rest.x)))
        held_ma = memory.hold_ma
        if held_ma is None or abs(middle_ma - held_ma) > self.settings.hold_step_ma:
            return replace(memory, hold_ma=middle_ma), middle_ma
        return memory, held_ma


_EVEN_SIGMA = 0.58
"""The standard deviation of an even distribution, as a part of half its width: the pressure at the start is anywhere
in the stick band."""
_INSTANT_S = 1e-9
"""Rounding of a sum of periods."""
