"""A breakaway from rest by a slow ramp, or a step beyond it; then the stem is caught again. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.commissioning.known import SMOOTHING_S
from positioner.commissioning.record import Kind, Stretch, longer, stretch
from positioner.values import dataclass, replace

if TYPE_CHECKING:
    from positioner.commissioning.stages import StageState, World
    from positioner.laws.law import Observation

_HOLD_S = 1.2
_RAISE_S = 0.3
_RAISED = 0.8
"""The ramp begins at this part of the sliding friction."""
RAMP_MA_PER_S = 3.0
"""A stem with strong damping creeps and slips by turns under a slower ramp: how often, hangs by a hair."""
_CAUGHT_S = 1.0
_STEP_CAUGHT_S = 0.5
_QUICK_HOLD_S, _QUICK_CAUGHT_S = 0.4, 0.3
_QUICK_S, _QUICK_PERIODS = 0.03, 2.0
"""A valve is quick where its slips were seen within this time and so many periods after each step."""
_AHEAD_OF_SPAN = 0.05
"""After a step the current goes to the balance of a place so far ahead."""
_GIVE_UP_S = 3.0
_SIGMA = 6.0
_LEAST_OF_SPAN = 0.0012
_MOST_DRIFT_OF_SPAN = 0.03


@dataclass(frozen=True, slots=True)
class Release:
    """Frees the resting stem in `direction`: by a slow ramp, or by a step of (1 + `over`) times the friction.

    repeats: a step that only a quick valve makes, with short pauses: so many of them show a lag of a few milliseconds.
    """

    direction: float
    over: float
    repeats: bool = False

    @property
    def doing(self) -> str:
        """What the stage does."""
        way = "up" if self.direction > 0.0 else "down"
        return f"step {way}" if self.over else f"breakaway {way}"

    def lasts_s(self, world: World) -> float:
        """Return the usual time."""
        if self.over:
            return self._hold_s + 0.2 * (not self.repeats) + self._caught_s
        return _HOLD_S + _RAISE_S + 0.5 * world.line.friction_ma / RAMP_MA_PER_S + _CAUGHT_S

    @property
    def _hold_s(self) -> float:
        return _QUICK_HOLD_S if self.repeats else _HOLD_S

    @property
    def _caught_s(self) -> float:
        if self.repeats:
            return _QUICK_CAUGHT_S
        return _STEP_CAUGHT_S if self.over else _CAUGHT_S

    def advance(self, world: World, state: StageState, observation: Observation) -> tuple[World, StageState]:
        """Return world and state after an observation."""
        state = state.observed(observation)
        if self.repeats and world.answer_s > _QUICK_S + _QUICK_PERIODS * world.period_s:
            return world, replace(state, done=True)
        state = replace(state, trail=longer(state.trail, observation, world.period_s))
        match state.phase:
            case 0:
                return world, self._held(world, state, observation)
            case 1:
                answer_s = state.phase_s
                state = self._pushed(world, state)
                if state.slip >= 0 and not self.over:
                    force_ma = self.direction * (state.current_ma - world.line.balance_ma(state.mean.mean_m))
                    world = replace(world, static_ma=max(world.static_ma, force_ma))
                elif state.phase > 1:
                    world = replace(world, answer_s=max(world.answer_s, answer_s))
                return world, self._caught(world, state) if state.phase > 1 else state
            case _:
                return world, self._caught(world, state)

    def _held(self, world: World, state: StageState, observation: Observation) -> StageState:
        """Hold the current of the place where the stem rests, and average its readings."""
        held = state.held + round(observation.elapsed_s / world.period_s)
        mean = state.mean.add(observation.measured_m) if 4.0 * state.time_s > self._hold_s else state.mean
        state = replace(state, held=held, mean=mean)
        if state.phase_s < self._hold_s:
            return state
        most_m = max(_MOST_DRIFT_OF_SPAN * world.limits.span_m, _SIGMA * mean.sigma_m)
        assert state.smooth_m is not None  # noqa: S101 - it has been observed
        if abs(state.smooth_m - mean.mean_m) > most_m:
            off_mm = 1e3 * (state.smooth_m - mean.mean_m)
            text = f"the stem moved {off_mm:.1f} mm under a constant current of {state.current_ma:.2f} mA"
            return replace(state, implausible=text)
        return self._pushed(world, replace(state, smooth_m=mean.mean_m).next_phase())

    def _pushed(self, world: World, state: StageState) -> StageState:
        """Raise the force until the stem has certainly moved."""
        assert state.smooth_m is not None  # noqa: S101 - it has been observed
        mean = state.mean
        gone_m = self.direction * (state.smooth_m - mean.mean_m)
        smooth = world.period_s / (SMOOTHING_S + world.period_s)
        threshold_m = max(
            _SIGMA * mean.sigma_m * math.sqrt(smooth / (2.0 - smooth)), _LEAST_OF_SPAN * world.limits.span_m
        )
        samples = state.held + round(state.phase_s / world.period_s)
        current_ma = self._force_ma(world, state)
        stopped = current_ma in {world.limits.current_low_ma, world.limits.current_high_ma}
        if gone_m > threshold_m:
            return replace(state, slip=samples).next_phase()
        if stopped and state.phase_s > _GIVE_UP_S + 4.0 * world.line.friction_ma / RAMP_MA_PER_S:
            return state.next_phase()
        return replace(state, current_ma=current_ma)

    def _force_ma(self, world: World, state: StageState) -> float:
        """Return the current in mA that pushes the resting stem at this instant."""
        line, time_s = world.line, state.phase_s
        balance_ma = line.balance_ma(state.mean.mean_m)
        if self.over:
            force_ma = (1.0 + self.over) * max(world.static_ma, line.friction_ma)
        else:
            raised = min(time_s / _RAISE_S, 1.0) * _RAISED * line.friction_ma
            force_ma = raised + RAMP_MA_PER_S * max(time_s - _RAISE_S, 0.0)
        return world.within(balance_ma + self.direction * force_ma)

    def _caught(self, world: World, state: StageState) -> StageState:
        """Take the current to the middle of the stick band where the stem comes to rest."""
        assert state.smooth_m is not None  # noqa: S101 - it has been observed
        ahead_m = self.direction * _AHEAD_OF_SPAN * world.limits.span_m
        here_m = state.mean.mean_m + ahead_m if self.over and state.slip >= 0 else state.smooth_m
        current_ma = world.within(world.line.balance_ma(here_m))
        return replace(state, current_ma=current_ma, done=state.phase_s >= self._caught_s)

    def recorded(self, state: StageState) -> tuple[Stretch, ...]:
        """Return the release; nothing where the stem could not be freed."""
        if state.slip < 0:
            return ()
        kind = Kind.STEP if self.over else Kind.BREAKAWAY
        rate = 0.0 if self.over else RAMP_MA_PER_S
        return (stretch(state.trail, kind, self.direction, rate, state.held, state.slip),)
