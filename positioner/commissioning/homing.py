"""The way back to where the stem was before the experiment. Pure.

The stem slides past the start, turns, and slides onto it; at the start the current goes to the middle of the stick
band, and the friction stops the stem. So neither the friction nor the lag need be known.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.commissioning.known import Mean
from positioner.values import dataclass, replace

if TYPE_CHECKING:
    from positioner.commissioning.record import Stretch
    from positioner.commissioning.stages import StageState, World
    from positioner.laws.law import Observation

_RATE_MA_PER_S = 2.0
_LANDING_MA_PER_S = 1.0
_SMOOTHING_S = 0.03
_MARGIN_OF_SPAN = 0.08
"""How far past the start the stem goes first: more than the jump at its next breakaway. It doubles with each try."""
_NEAR_OF_SPAN = 0.003
_MOST_TRIES = 3
_SETTLE_S = 1.0
_PAST, _ONTO, _SETTLE = 0, 1, 2


@dataclass(frozen=True, slots=True)
class Return:
    """Brings the stem back to the start, as far as the current reaches it."""

    @property
    def doing(self) -> str:
        """What the stage does."""
        return "returning to the start"

    def lasts_s(self, world: World) -> float:
        """Return the usual time of one try."""
        return 4.0 * world.line.friction_ma / _RATE_MA_PER_S + _SETTLE_S

    def advance(self, world: World, state: StageState, observation: Observation) -> tuple[World, StageState]:
        """Return world and state after an observation."""
        state = state.observed(observation, smoothing_s=_SMOOTHING_S)
        assert state.smooth_m is not None  # noqa: S101 - it has been observed
        off_m = state.smooth_m - world.start_m
        if state.tries == 0:
            if abs(off_m) <= _NEAR_OF_SPAN * world.limits.span_m:  # nothing has moved yet
                return world, replace(state, done=True)
            margin_m = _MARGIN_OF_SPAN * world.limits.span_m
            state = replace(state, tries=1, margin_m=margin_m if off_m < 0.0 else -margin_m, phase_s=0.0)
        # it slides past the start to the side of `margin_m`, and onto it from there
        side = 1.0 if state.margin_m > 0.0 else -1.0
        match state.phase:
            case 0:
                arrived = side * off_m >= abs(state.margin_m)
                state = self._driven(world, state, observation, side, _RATE_MA_PER_S, arrived=arrived)
            case 1:
                state = self._driven(world, state, observation, -side, _LANDING_MA_PER_S, arrived=-side * off_m >= 0.0)
            case _:
                state = self._settled(world, state, observation)
        return world, state

    def _driven(
        self, world: World, state: StageState, observation: Observation, direction: float, rate: float, *, arrived: bool
    ) -> StageState:
        """Drive the stem in `direction` until it has arrived, or until the current ends."""
        limits = world.limits
        end_ma = limits.current_high_ma if direction > 0.0 else limits.current_low_ma
        ended = state.current_ma == end_ma and state.phase_s > 1.0
        if arrived or ended:
            return state.next_phase()
        current_ma = world.towards(state.current_ma, end_ma, rate, observation.elapsed_s)
        return replace(state, current_ma=current_ma, phase_s=0.0 if current_ma != end_ma else state.phase_s)

    def _settled(self, world: World, state: StageState, observation: Observation) -> StageState:
        """Hold the stem in the middle of its stick band; try again where it is not near enough."""
        current_ma = world.within(world.line.balance_ma(world.start_m))
        mean = state.mean.add(observation.measured_m) if 2.0 * state.phase_s > _SETTLE_S else state.mean
        state = replace(state, current_ma=current_ma, mean=mean)
        if state.phase_s < _SETTLE_S:
            return state
        off_m = mean.mean_m - world.start_m
        if abs(off_m) <= _NEAR_OF_SPAN * world.limits.span_m or state.tries == _MOST_TRIES:
            return replace(state, done=True)
        margin_m = 2.0 * abs(state.margin_m)
        return replace(
            state,
            tries=state.tries + 1,
            margin_m=margin_m if state.margin_m > 0.0 else -margin_m,
            phase=_PAST,
            phase_s=0.0,
            mean=Mean(),
        )

    def recorded(self, state: StageState) -> tuple[Stretch, ...]:  # noqa: ARG002 - the interface's
        """Return nothing."""
        return ()
