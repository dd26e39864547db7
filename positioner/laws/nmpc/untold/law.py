"""The law `nmpc` where no actuator lag is configured: it looks for one that nobody has told. Pure, but for its solver.

It plays as `NmpcLaw` does, to the bit, until its watch finds certain evidence of another actuator. Then `LaggedLaw`
takes over at the next rest, with the lag and the load that explain the moves best, and refines them. Only where push
after push has failed, and a lag may be the reason, it waits for the watch. It may make an experiment there (`probe`),
but makes none: `UntoldLagLaw` says why.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.laws.bounds import Bounds
from positioner.laws.estimator_settings import measurement_sigma_m
from positioner.laws.law import Decision
from positioner.laws.nmpc.filter import Resting, spread_of
from positioner.laws.nmpc.lagged.pipeline import pipeline_at
from positioner.laws.nmpc.lagged.rest import LaggedRest
from positioner.laws.nmpc.memory import NmpcMemory, report
from positioner.laws.nmpc.untold import watch as watching
from positioner.laws.nmpc.untold.found import actuator_of
from positioner.laws.nmpc.untold.probe import LEAST_READINGS, MOST, probe_of
from positioner.laws.pushes import Pushes
from positioner.values import dataclass, replace
from positioner.wire.messages import Motion

if TYPE_CHECKING:
    from collections.abc import Callable

    from positioner.laws.law import Estimate, Observation
    from positioner.laws.nmpc.lagged.law import LaggedLaw
    from positioner.laws.nmpc.lagged.memory import LaggedMemory
    from positioner.laws.nmpc.law import NmpcLaw
    from positioner.laws.nmpc.untold.load import Nominal
    from positioner.laws.nmpc.untold.probe import Probe
    from positioner.laws.nmpc.untold.watch import Watch
    from positioner.valve.actuator import ActuatorParameters
    from positioner.valve.state import StemState
    from positioner.valve.stiction import StictionTable


_MOST_NOISE = 200.0
"""The variance of an average is believed to be at most so many times that of white noise: AR(0.99)."""

_WHITE = 3.0
"""The same for an experiment: readings of pushes that move the stem a little look like noise, too."""
_SEEN_OF_JUMP = 0.5
"""Standard deviation of a reading, as a part of (F_s - F_c)/K, up to which an experiment is made. Noise that remembers
itself hides the motion of a push, too, and then it has not failed."""


@dataclass(frozen=True, slots=True)
class UntoldMemory:
    """What the law carries: the memory of the law that plays, the watch, and once it is found the true actuator.

    law: the law for that actuator. probe: the present experiment. probes: how many there were.
    """

    inner: NmpcMemory | LaggedMemory
    watch: Watch
    actuator: ActuatorParameters | None = None
    law: LaggedLaw | None = None
    probe: Probe | None = None
    probes: int = 0


@dataclass(frozen=True, slots=True)
class UntoldLagLaw:
    """The law; `lagged` makes the one for another actuator.

    experiments: whether it makes experiments. It does not, since most valves have no lag that is not configured, and an
    experiment pushes their stems as well and holds them displaced: single dwells then ended 3 to 5 % off. Tests of the
    experiment switch it on.
    """

    name: str
    believed: NmpcLaw
    lagged: Callable[[ActuatorParameters], LaggedLaw]
    nominal: Nominal
    experiments: bool = False

    def begin(self, measured_m: float) -> UntoldMemory:
        """Return the memory of a stem that rests somewhere."""
        return UntoldMemory(self.believed.begin(measured_m), watching.begun(self.believed.period_s))

    def estimate(self, memory: UntoldMemory, observation: Observation) -> tuple[UntoldMemory, Estimate]:
        """Return the memory and the stem after this cycle's reading."""
        inner = memory.inner
        if memory.law is not None:
            assert not isinstance(inner, NmpcMemory)  # noqa: S101 - of the law that plays
            lagged, estimate = memory.law.estimate(inner, observation)
            return replace(memory, inner=lagged), estimate
        assert isinstance(inner, NmpcMemory)  # noqa: S101 - of the law that plays
        watch, probe = memory.watch, memory.probe
        if probe is None or probe.is_over:
            inner, estimate = self.believed.estimate(inner, observation)
        else:
            assert isinstance(inner.stem, Resting)  # noqa: S101 - an experiment begins at rest
            noise_m2 = self._noise_m2(inner, _WHITE)
            probe, estimate = probe.followed_by(observation.measured_m, noise_m2), report(inner.stem)
            if probe.is_over and probe.has_moved:
                inner = self._moved(inner, probe, noise_m2)
        if not watch.is_over:
            rests = inner.motion is Motion.REST and (probe is None or probe.is_over)
            noise_m2 = self._noise_m2(inner)
            if observation.disturbed:
                watch = watching.cut(watch, noise_m2)
            for _ in range(max(round(observation.elapsed_s / self.believed.period_s), 1)):
                watch = watching.read(watch, observation.applied_ma, observation.measured_m, noise_m2, rests=rests)
            if rests or watch.course is None:  # a move of a law that believes in no lag may have no end
                watch = watching.worked(self.nominal, watch, self.believed.period_s)
        return replace(memory, inner=inner, watch=watch, probe=probe), estimate

    def decide(
        self, memory: UntoldMemory, stem: StemState, observation: Observation, table: StictionTable
    ) -> tuple[UntoldMemory, Decision]:
        """Return the memory after the decision, and the decision."""
        inner = memory.inner
        if memory.law is None and observation.actuator is not None and isinstance(inner, NmpcMemory):
            memory = self._with(memory, inner, observation.actuator)
        elif memory.law is None and isinstance(inner, NmpcMemory) and inner.motion is Motion.REST:
            leader = memory.watch.leader
            if leader is not None and (memory.probe is None or memory.probe.is_over):
                memory = self._with(memory, inner, actuator_of(memory.watch, self.believed.period_s))
        inner = memory.inner
        if memory.law is not None:
            assert not isinstance(inner, NmpcMemory)  # noqa: S101 - of the law that plays
            lagged, decision = memory.law.decide(inner, stem, observation, table)
            return replace(memory, inner=lagged), replace(decision, actuator=memory.actuator)
        assert isinstance(inner, NmpcMemory)  # noqa: S101 - of the law that plays
        return self._watched(memory, inner, stem, observation, table)

    def _watched(
        self,
        memory: UntoldMemory,
        inner: NmpcMemory,
        stem: StemState,
        observation: Observation,
        table: StictionTable,
    ) -> tuple[UntoldMemory, Decision]:
        """Return the memory and the decision of the law that believes in no lag, or that of an experiment."""
        watch, probe = memory.watch, memory.probe
        if probe is not None:
            waits = watch.is_at_work and observation.setpoint_m == inner.setpoint_m
            if waits or not probe.is_over:
                return memory, self._probing(probe)
            memory = replace(memory, probe=None)
        if inner.setpoint_m is None and table.fit is not None:
            watch = watching.with_kept(watch, table.fit.fill_s)
        before = inner
        inner, decision = self.believed.decide(inner, stem, observation, table)
        if decision.reason is not None and before.hold_ma is not None and self._suspects(memory, before):
            if len(watch.waiting) > 1 and observation.setpoint_m == before.setpoint_m:
                return memory, self._resting(before.hold_ma, Motion.REST)
            if self.experiments and memory.probes < MOST and watch.quiet.readings >= LEAST_READINGS:
                return self._probed(memory, before.hold_ma, decision)
        if decision.reason is not None and not watch.is_over:
            assert not isinstance(inner.stem, Resting)  # noqa: S101 - a move has begun
            watch = watching.pushed(watch, inner.stem.direction, self._noise_m2(inner))
        return replace(memory, inner=inner, watch=watch), decision

    def _suspects(self, memory: UntoldMemory, inner: NmpcMemory) -> bool:
        """Whether pushes may fail by a lag: where the readings would show the jump of a stem that was freed."""
        load, static_n = self.nominal.load, self.nominal.static_n
        seen_m = _SEEN_OF_JUMP * (static_n - load.friction_n) / load.spring_n_per_m
        return self._noise_m2(inner, math.inf) < seen_m * seen_m and memory.watch.wants_probe

    def _probed(self, memory: UntoldMemory, held_ma: float, push: Decision) -> tuple[UntoldMemory, Decision]:
        """Return the memory and the first current of an experiment in place of a push."""
        watch, reason = memory.watch, push.reason
        assert isinstance(memory.inner, NmpcMemory)  # noqa: S101 - of the law that plays
        assert reason is not None  # noqa: S101 - a move begins
        noise_m2, gamma_ma, period_s = self._noise_m2(memory.inner), reason.breakaway.current_ma, self.believed.period_s
        white_m2 = self._noise_m2(memory.inner, _WHITE)
        probe = probe_of(watch.quiet, white_m2, held_ma, push.current_ma, gamma_ma, memory.probes, period_s)
        watch = watching.pushed(watch, probe.direction, noise_m2, is_probe=True)
        memory = replace(memory, watch=watch, probe=probe, probes=memory.probes + 1)
        return memory, replace(self._probing(probe), reason=reason)

    def _probing(self, probe: Probe) -> Decision:
        """Return the current of an experiment."""
        if probe.is_held:
            return self._resting(probe.current_ma, Motion.MOVE)
        return self._resting(probe.held_ma, Motion.REST if probe.is_over else Motion.SETTLE)

    def _resting(self, current_ma: float, motion: Motion) -> Decision:
        """Return the decision for a current that no plan has asked for."""
        own = self.believed
        return Decision(current_ma, Bounds(0.0, 0.0, own.current_low_ma, own.current_high_ma), motion)

    def _moved(self, inner: NmpcMemory, probe: Probe, noise_m2: float) -> NmpcMemory:
        """Return the memory of the law after an experiment has moved its stem."""
        stem, filtered = inner.stem, self.believed.filter
        assert isinstance(stem, Resting)  # noqa: S101 - an experiment begins at rest
        after = filtered.at_rest(probe.recent_m, noise_m2, stem.load, spread_of(stem))
        monitor = replace(inner.monitor.at_new_place(), verification=None, landing=None)
        return replace(inner, stem=after, monitor=monitor, hold_ma=None)

    def _noise_m2(self, inner: NmpcMemory, most: float = _MOST_NOISE) -> float:
        """Return the variance of the mean of n readings, times n, believed to be at most so many times the told one."""
        stem, own = inner.stem, self.believed
        place_m = stem.anchor.x if isinstance(stem, Resting) else stem.x
        sigma_m = measurement_sigma_m(own.estimator, own.valve, place_m)
        # readings of a stem that moves, although it should rest, look like noise
        return min(inner.monitor.noise.averaged, most) * sigma_m * sigma_m

    def _rest(self, watch: Watch, stem: Resting) -> LaggedRest:
        """Return the rest by the last readings: what the law believed of the stem need not be true."""
        quiet, own = watch.quiet, self.believed
        if quiet.readings == 0:
            return LaggedRest(stem.x, own.valve.span_m * own.valve.span_m)
        sigma_m = measurement_sigma_m(own.estimator, own.valve, quiet.mean_m)
        return LaggedRest(quiet.mean_m, sigma_m * sigma_m / quiet.readings)

    def _with(self, memory: UntoldMemory, inner: NmpcMemory, actuator: ActuatorParameters) -> UntoldMemory:
        """Return the memory in which the law for `actuator` takes over the resting stem."""
        law, stem = self.lagged(actuator), inner.stem
        assert isinstance(stem, Resting)  # noqa: S101 - it takes over at rest
        begun = law.begin(stem.x)
        drive, model = begun.drive, self.nominal.model
        leader = memory.watch.leader
        belief, hold_ma = begun.belief, inner.hold_ma
        if leader is not None:
            load = leader.belief.load(self.nominal)
            belief = law.lagged.prior(load.spring_n_per_m, leader.belief.static_n(self.nominal), load.friction_n)
        if hold_ma is None:
            hold_ma = drive.limited(model.current_ma(belief.onsets.spring_n_per_m * stem.x))
        lagged = replace(
            begun,
            stem=self._rest(memory.watch, stem),
            pipeline=pipeline_at(hold_ma, begun.pipeline.doubt_ma, law.lagged.dead_time_s, law.lagged.period_s),
            belief=belief,
            setpoint_m=inner.setpoint_m,
            anchor_m=inner.setpoint_m if inner.setpoint_m is not None else 0.0,
            is_new=True,
            hold_ma=hold_ma,
            pushes=Pushes(anchor_m=inner.setpoint_m),
        )
        return UntoldMemory(lagged, memory.watch, actuator, law)
