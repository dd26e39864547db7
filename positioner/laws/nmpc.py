"""The law `nmpc`: predictive control that knows when the stem stops, learns why it did not stop where meant, and waits.

Pure, but for the solver inside. Three motions:

    HOLD    the stem rests in the middle of its stick band; readings are averaged until an error is beyond doubt
    MOVE    Γ frees the stem, then the LTV-QP of `nmpc_plan` takes it to the setpoint as fast as it can still stop
    SETTLE  the model says it has stopped: the middle of the stick band for some milliseconds, then HOLD
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from positioner.adaptive_estimate import Resting, Sliding, average
from positioner.bounds import Bounds
from positioner.breakaway import Recollection, breakaway, lesson, recollect
from positioner.estimate import StemState, measurement_sigma_m
from positioner.laws.law import Decision
from positioner.laws.nmpc_plan import Course, approach
from positioner.laws.nmpc_trial import Trial, Verdict, judge
from positioner.sensor_noise import NoiseLevel
from positioner.stiction import LearnedSample, Quantity, direction_of
from positioner.wire.messages import Motion

if TYPE_CHECKING:
    from positioner.adaptive_estimate import AdaptiveFilter
    from positioner.estimate import EstimatorSettings
    from positioner.laws.law import Observation
    from positioner.laws.nmpc_settings import NmpcSettings
    from positioner.model import ValveParameters
    from positioner.planner import Solver
    from positioner.stiction import StictionTable


@dataclass(frozen=True, slots=True)
class NmpcMemory:
    """What the law carries.

    stem: the estimate, of a sliding stem while motion is MOVE, else of a resting one.
    noise: what is known of the sensor. drift: smoothed innovation of a resting stem, in σ.
    ratio: F_s/F_c. trial: the last move, while it is not sure that it happened.
    settle_s: what is left of SETTLE. hold_ma: the current that is held, None to choose one.
    plan_ma: the last plan, shifted. setpoint_m, corrections: the setpoint pursued, and moves made for it.
    recalled: whether the table has been asked for K and F.
    """

    stem: Resting | Sliding
    motion: Motion = Motion.HOLD
    noise: NoiseLevel = NoiseLevel()  # noqa: RUF009 - immutable
    drift: float = 0.0
    ratio: float = 1.0
    trial: Trial | None = None
    settle_s: float = 0.0
    hold_ma: float | None = None
    plan_ma: tuple[float, ...] = ()
    setpoint_m: float = math.nan
    corrections: int = 0
    recalled: bool = False


@dataclass(frozen=True, slots=True)
class NmpcLaw:
    """Our law. `solver` takes H_u variables and H_u + H_p rows."""

    name: str
    valve: ValveParameters
    settings: NmpcSettings
    estimator: EstimatorSettings
    filter: AdaptiveFilter
    solver: Solver
    current_low_ma: float
    current_high_ma: float
    period_s: float
    table_cell_m: float

    def begin(self, measured_m: float) -> NmpcMemory:
        """Return the memory of a stem somewhere on its travel; the first `estimate` takes the reading itself."""
        ratio = self.valve.static_friction_n / max(self.valve.coulomb_friction_n, 1e-9)
        return NmpcMemory(self.filter.first(measured_m, self.valve.span_m), ratio=max(ratio, 1.0))

    # ------------------------------------------------------------------------------------------------- estimate

    def estimate(self, memory: NmpcMemory, observation: Observation) -> tuple[NmpcMemory, StemState]:
        """Return the memory and the stem after this cycle's reading: a Kalman filter in motion, an average at rest."""
        stem = memory.stem
        sigma = measurement_sigma_m(self.estimator, self.valve, stem.x)
        variance = max(memory.noise.ratio, _LEAST_NOISE) * sigma * sigma
        if isinstance(stem, Sliding):
            return self._slide(memory, stem, observation, variance)
        return self._rest(memory, stem, observation, variance, sigma)

    def _slide(
        self, memory: NmpcMemory, stem: Sliding, observation: Observation, variance: float
    ) -> tuple[NmpcMemory, StemState]:
        ahead = self.filter.advance(stem, observation.applied_ma, observation.elapsed_s)
        after = self.filter.correct(ahead, observation.measured_m, variance)
        if not after.stopped:
            return replace(memory, stem=after), _report(after, ())
        taught = LearnedSample(Quantity.STICK_SPEED, after.x, direction_of(stem.direction), abs(stem.v))
        rest = self.filter.rest(after)
        memory = replace(
            memory,
            stem=rest,
            motion=Motion.SETTLE,
            settle_s=self.settings.settle_s,
            hold_ma=None,
            noise=memory.noise.moved(),
            drift=0.0,
        )
        return memory, _report(rest, (taught,))

    def _rest(
        self, memory: NmpcMemory, stem: Resting, observation: Observation, variance: float, sigma: float
    ) -> tuple[NmpcMemory, StemState]:
        measured = observation.measured_m
        innovation = (measured - stem.x) / math.sqrt(stem.variance_m2 + variance)
        after, taught = average(stem, measured, variance), ()
        if memory.motion is Motion.SETTLE:
            left = memory.settle_s - observation.elapsed_s
            motion = Motion.SETTLE if left > _INSTANT_S else Motion.HOLD
            return replace(memory, stem=after, settle_s=left, motion=motion), _report(after, ())
        weight = self.settings.surprise_smoothing
        drift = memory.drift + weight * (innovation - memory.drift)
        noise, ratio, trial = memory.noise.heard(measured / sigma), memory.ratio, memory.trial
        if trial is not None:
            trial, after, ratio, taught = self._judge(trial, stem, after, ratio, measured, variance)
            if trial is None:
                drift = 0.0
        if abs(drift) > self.settings.surprise_sigma * math.sqrt(weight / (2.0 - weight)):
            # a stem that should rest has moved: begin its average anew
            after, drift, noise = self._surprised(stem, drift, variance), 0.0, memory.noise.moved()
        memory = replace(memory, stem=after, drift=drift, noise=noise, ratio=ratio, trial=trial)
        return memory, _report(after, taught)

    def _judge(
        self, trial: Trial, before: Resting, after: Resting, ratio: float, measured: float, variance: float
    ) -> tuple[Trial | None, Resting, float, tuple[LearnedSample, ...]]:
        """Return the trial, the estimate, F_s/F_c and what was learned, after weighing one more reading."""
        trial, verdict = judge(trial, before, measured, variance, self.settings.verdict)
        if verdict is Verdict.OPEN:
            return trial, after, ratio, ()
        own, slider = self.settings.breakaway, self.filter.slider
        if verdict is Verdict.STUCK:
            after = trial.origin
            ratio = max(ratio, trial.push_n / after.F) * (1.0 + own.rise)
        elif trial.at_limit:
            ratio = max(1.0, ratio * (1.0 - own.fall))
        taught = lesson(
            slider, self.table_cell_m, trial.origin.x, trial.direction, after.K, ratio * after.F
        )
        return None, after, ratio, (taught,)

    def _surprised(self, stem: Resting, drift: float, variance: float) -> Resting:
        shift = drift * math.sqrt(stem.variance_m2 + variance)
        sigmas = (math.sqrt(stem.anchor.covariance[2, 2]), math.sqrt(stem.anchor.covariance[3, 3]))
        return self.filter.informed(stem.x + shift, shift * shift + variance, (stem.K, stem.F), sigmas)

    # --------------------------------------------------------------------------------------------------- decide

    def decide(
        self, memory: NmpcMemory, stem: StemState, observation: Observation, table: StictionTable
    ) -> tuple[NmpcMemory, Decision]:
        """Return the current that holds, that frees, or that the plan begins with."""
        if not memory.recalled:
            memory = self._recalled(memory, table)
        if observation.setpoint_m != memory.setpoint_m:
            memory = replace(memory, setpoint_m=observation.setpoint_m, corrections=0)
        here = memory.stem
        if isinstance(here, Sliding):
            return self._move(memory, here)
        if memory.motion is Motion.HOLD and self._is_worth_a_move(memory, here):
            return self._start(memory, here, table)
        return self._hold(memory, here)

    def _is_worth_a_move(self, memory: NmpcMemory, here: Resting) -> bool:
        """Whether the error is beyond tolerance and doubt; an undecided trial is waited for, but not a new setpoint."""
        own = self.settings
        if memory.corrections and memory.trial is not None:
            return False
        tolerance = own.tolerance_m * (1.0 + own.patience * min(memory.corrections, own.patience_limit))
        return abs(memory.setpoint_m - here.x) > tolerance + own.doubt_sigma * here.sigma_m

    def _hold(self, memory: NmpcMemory, here: Resting) -> tuple[NmpcMemory, Decision]:
        """Return the middle of the stick band, followed in steps only."""
        middle = self._clamp(self.filter.slider.current_ma(here.K * here.x))
        held = memory.hold_ma
        if held is None or abs(middle - held) > self.settings.hold_step_ma:
            memory, held = replace(memory, hold_ma=middle), middle
        return memory, Decision(held, Bounds(0.0, 0.0, self.current_low_ma, self.current_high_ma), memory.motion)

    def _start(self, memory: NmpcMemory, here: Resting, table: StictionTable) -> tuple[NmpcMemory, Decision]:
        """Return the first current of a move: at least Γ, for one sample (eqs 25, 26; D8)."""
        direction = math.copysign(1.0, memory.setpoint_m - here.x)
        slider, static_n = self.filter.slider, memory.ratio * here.F
        gamma = breakaway(self.settings.breakaway, slider, table, here.x, direction, here.K, static_n)
        release = self._clamp(gamma.current_ma)
        sliding = self.filter.depart(here, direction)
        memory = replace(memory, motion=Motion.MOVE, stem=sliding, plan_ma=(), corrections=memory.corrections + 1)
        memory, decision = self._move(memory, sliding, release)
        push_n = direction * slider.push_n(decision.current_ma, 0.0, 0.0) - direction * here.K * here.x
        at_limit = direction * (decision.current_ma - release) <= _SAME_MA
        trial = Trial(here, direction, push_n, at_limit)
        source = f"table, {gamma.samples} samples" if gamma.samples else "model"
        why = f"error {1e3 * (memory.setpoint_m - here.x):+.3f} mm; breakaway {gamma.current_ma:.3f} mA ({source})"
        return replace(memory, trial=trial), replace(decision, reason=why)

    def _move(
        self, memory: NmpcMemory, here: Sliding, release_ma: float | None = None
    ) -> tuple[NmpcMemory, Decision]:
        """Return the first current of the plan; `release_ma` is Γ while the stem still sticks."""
        s, own, slider = here.direction, self.settings, self.filter.slider
        # a setpoint that has come to lie behind is for the next move: this one stops where it can
        target = memory.setpoint_m if s * (memory.setpoint_m - here.x) > 0.0 else here.x
        middle_n, static_n = here.K * target, memory.ratio * here.F
        brake = self._clamp(slider.current_ma(middle_n - s * own.brake_share * static_n))
        weakest = self._clamp(slider.current_ma(middle_n - s * own.brake_limit * here.F))
        strongest = self.current_high_ma if s > 0.0 else self.current_low_ma
        release = weakest if release_ma is None else s * max(s * release_ma, s * weakest)
        course = Course(here.x, here.v, s, target, here.K, here.F, brake, weakest, strongest, release)
        guess = memory.plan_ma or (release, *(brake,) * (own.approach.control_steps - 1))
        found = approach(own.approach, slider, self.solver, course, guess, self.period_s)
        low, high = sorted((release, strongest))
        if found is None:
            bounds = Bounds(-math.inf, math.inf, low, high)
            return replace(memory, plan_ma=()), Decision(release, bounds, Motion.MOVE, 0, "no plan: full braking")
        limit = found.speed_limit_m_per_s
        bounds = Bounds(0.0, limit, low, high) if s > 0.0 else Bounds(limit, 0.0, low, high)
        memory = replace(memory, plan_ma=(*found.inputs_ma[1:], found.inputs_ma[-1]))
        return memory, Decision(found.inputs_ma[0], bounds, Motion.MOVE, found.passes)

    def _recalled(self, memory: NmpcMemory, table: StictionTable) -> NmpcMemory:
        """Return the memory with what the table remembers of K and F_s: after a restart the law is what it was."""
        stem, own, valve = memory.stem, self.settings.adaptation, self.valve
        if not isinstance(stem, Resting):
            return replace(memory, recalled=True)
        prior = Recollection(
            valve.spring_rate_n_per_m,
            valve.static_friction_n,
            max(own.spring_sigma, 1e-3) * valve.spring_rate_n_per_m,
            max(own.friction_sigma * valve.static_friction_n, 1.0),
        )
        past = recollect(self.settings.breakaway, self.filter.slider, table, prior)
        values = (past.spring_n_per_m, past.static_n / memory.ratio)
        sigmas = (past.spring_sigma, past.static_sigma / memory.ratio)
        return replace(memory, stem=self.filter.informed(stem.x, stem.variance_m2, values, sigmas), recalled=True)

    def _clamp(self, current_ma: float) -> float:
        return min(max(current_ma, self.current_low_ma), self.current_high_ma)


_LEAST_NOISE = 1e-6
"""Of the configured variance: what is never believed of a sensor."""
_INSTANT_S = 1e-9
"""Rounding of a sum of periods."""
_SAME_MA = 0.05
"""Currents closer than this push alike."""


def _report(stem: Resting | Sliding, taught: tuple[LearnedSample, ...]) -> StemState:
    """Return the estimate as every other part of the positioner knows it."""
    if isinstance(stem, Resting):
        return StemState(stem.x, 0.0, True, stem.anchor.direction, stem.variance_m2, 0.0, 0.0, 0.0, taught)
    p = stem.covariance
    return StemState(
        stem.x, stem.v, False, stem.direction, float(p[0, 0]), float(p[0, 1]), float(p[1, 1]), 0.0, taught
    )
