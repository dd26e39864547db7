"""The stages that lead an experiment: rest, stroke, the way to the middle, and the return to the start. Pure.

A stage is immutable. What changes is the `StageState`, which begins anew with each stage, and the `World`, which goes
through all of them.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Protocol

from positioner.commissioning.known import SMOOTHING_S, Line, Mean, Moments, line_of
from positioner.commissioning.record import Kind, Stretch, Trail, longer, stretch
from positioner.values import dataclass, replace

if TYPE_CHECKING:
    from positioner.commissioning.procedure import ProcedureLimits
    from positioner.laws.law import Observation

_SLIDES_S = 0.5
"""A stem slides where its mean reading has gone on for so long."""
_BLOCK_S = 0.02
_PAUSE_S = 0.5
_CERTAIN_SIGMA = 6.0
_MIDDLE_MA_PER_S = 2.0


@dataclass(frozen=True, slots=True)
class World:
    """What the stages share.

    line: of the sliding stem, believed at first, then measured; sigma_m: of a reading at rest; low_m, high_m: the ends
    of its way; up, down: the sums behind the line. static_ma: the largest force at a breakaway so far; answer_s: the
    longest time from a step until its slip was seen.
    """

    limits: ProcedureLimits
    period_s: float
    line: Line
    start_m: float
    sigma_m: float = 0.0
    low_m: float = math.inf
    high_m: float = -math.inf
    static_ma: float = 0.0
    answer_s: float = 0.0
    up: Moments = Moments()
    down: Moments = Moments()

    def within(self, current_ma: float) -> float:
        """Return the current within its limits, in mA."""
        return min(max(current_ma, self.limits.current_low_ma), self.limits.current_high_ma)

    def towards(self, from_ma: float, to_ma: float, rate_ma_per_s: float, elapsed_s: float) -> float:
        """Return the next current of a ramp to `to_ma`, within the limits of range and rate."""
        step = min(rate_ma_per_s, self.limits.rate_ma_per_s) * elapsed_s
        return self.within(min(max(to_ma, from_ma - step), from_ma + step))


@dataclass(frozen=True, slots=True)
class StageState:
    """The state of one stage.

    time_s, phase_s: since the stage and its phase began; smooth_m: the smoothed reading, None before the first one.
    mean: of the readings under constant current; blocks: means of short blocks, oldest first; block: the present one.
    held, slip: see `Stretch`; margin_m, tries: of the return.
    implausible: what no valve of this kind can do, else empty.
    """

    current_ma: float
    time_s: float = 0.0
    phase: int = 0
    phase_s: float = 0.0
    smooth_m: float | None = None
    mean: Mean = Mean()
    blocks: tuple[float, ...] = ()
    block: Mean = Mean()
    trail: Trail | None = None
    held: int = 0
    slip: int = -1
    margin_m: float = 0.0
    tries: int = 0
    done: bool = False
    implausible: str = ""

    def observed(self, observation: Observation, *, smoothing_s: float = SMOOTHING_S) -> StageState:
        """Return the state with time and smoothed reading brought forward."""
        before, elapsed_s = self.smooth_m, observation.elapsed_s
        weight = elapsed_s / (smoothing_s + elapsed_s)
        measured_m = observation.measured_m
        smooth_m = measured_m if before is None else before + weight * (measured_m - before)
        return replace(self, time_s=self.time_s + elapsed_s, phase_s=self.phase_s + elapsed_s, smooth_m=smooth_m)

    def next_phase(self) -> StageState:
        """Return the state at the beginning of the next phase."""
        return replace(self, phase=self.phase + 1, phase_s=0.0)


class Stage(Protocol):
    """One stage of an experiment."""

    @property
    def doing(self) -> str:
        """What the stage does, for a person."""

    def lasts_s(self, world: World) -> float:
        """Return how long the stage is expected to last, in s."""

    def advance(self, world: World, state: StageState, observation: Observation) -> tuple[World, StageState]:
        """Return world and state after an observation; the state has the current that is asked for."""

    def recorded(self, state: StageState) -> tuple[Stretch, ...]:
        """Return what the stage recorded."""


@dataclass(frozen=True, slots=True)
class Rest:
    """The current that the believed valve needs here, held for `duration_s`: the noise of the sensor."""

    duration_s: float

    @property
    def doing(self) -> str:
        """What the stage does."""
        return "measuring the noise at rest"

    def lasts_s(self, world: World) -> float:  # noqa: ARG002 - the interface's
        """Return its duration."""
        return self.duration_s

    def advance(self, world: World, state: StageState, observation: Observation) -> tuple[World, StageState]:
        """Return world and state after an observation; the first third of a rest does not count."""
        state = state.observed(observation)
        if 3.0 * state.time_s < self.duration_s:
            return world, state
        state = replace(
            state, mean=state.mean.add(observation.measured_m), trail=longer(state.trail, observation, world.period_s)
        )
        if state.time_s < self.duration_s:
            return world, state
        mean_m = state.mean.mean_m
        world = replace(world, start_m=mean_m, sigma_m=state.mean.sigma_m)
        return world, replace(state, done=True)

    def recorded(self, state: StageState) -> tuple[Stretch, ...]:
        """Return the readings at rest."""
        return (stretch(state.trail, Kind.REST),)


@dataclass(frozen=True, slots=True)
class Stroke:
    """A ramp to `to_ma`, and a pause there; `shows_line` where the line of the sliding stem is taken from it."""

    to_ma: float
    rate_ma_per_s: float
    records: bool = True
    shows_line: bool = False

    @property
    def doing(self) -> str:
        """What the stage does."""
        return f"stroke to {self.to_ma:g} mA at {self.rate_ma_per_s:g} mA/s"

    def lasts_s(self, world: World) -> float:
        """Return the time of a full stroke."""
        limits = world.limits
        return (limits.current_high_ma - limits.current_low_ma) / self.rate_ma_per_s + _PAUSE_S

    def advance(self, world: World, state: StageState, observation: Observation) -> tuple[World, StageState]:
        """Return world and state after an observation."""
        state = state.observed(observation)
        if self.records:
            state = replace(state, trail=longer(state.trail, observation, world.period_s))
        world, state = self._watched(world, state, observation)
        if state.current_ma != self.to_ma:
            current_ma = world.towards(state.current_ma, self.to_ma, self.rate_ma_per_s, observation.elapsed_s)
            return world, replace(state, current_ma=current_ma, phase_s=0.0)
        if state.phase_s < _PAUSE_S:
            return world, state
        if not self.shows_line or self.to_ma != world.limits.current_low_ma:
            return world, replace(state, done=True)
        line = line_of(world.up, world.down)
        if line is None:
            way_mm = 1e3 * max(world.high_m - world.low_m, 0.0)
            limits = world.limits
            text = f"the stem slid over {way_mm:.2f} mm while the current went from {limits.current_low_ma:g} to "
            text += f"{limits.current_high_ma:g} mA and back: look at air, actuator, sensor and the sign of the action"
            return world, replace(state, implausible=text)
        return replace(world, line=line), replace(state, done=True)

    def _watched(self, world: World, state: StageState, observation: Observation) -> tuple[World, StageState]:
        """Return both with the newest block of readings, as a point of the line where the stem slides."""
        block = state.block.add(observation.measured_m)
        if block.count * world.period_s < _BLOCK_S:
            return world, replace(state, block=block)
        kept = max(round(_SLIDES_S / (block.count * world.period_s)), 1)
        blocks = (*state.blocks, block.mean_m)[-kept - 1 :]
        state = replace(state, block=Mean(), blocks=blocks)
        if not self.shows_line or len(blocks) <= kept or state.current_ma == self.to_ma:
            return world, state
        direction = 1.0 if self.to_ma > state.current_ma else -1.0
        usual_m = self.rate_ma_per_s * _SLIDES_S * world.line.m_per_ma
        noise_m = _CERTAIN_SIGMA * world.sigma_m * (2.0 / block.count) ** 0.5
        margin_m = 0.02 * world.limits.span_m
        inside = world.limits.travel_min_m + margin_m < block.mean_m < world.limits.travel_max_m - margin_m
        if not inside or direction * (blocks[-1] - blocks[0]) < max(noise_m, 0.3 * usual_m):
            return world, state
        current_ma = state.current_ma - direction * self.rate_ma_per_s * 0.5 * block.count * world.period_s
        if direction > 0.0:
            high_m = max(world.high_m, block.mean_m)
            return replace(world, up=world.up.add(current_ma, block.mean_m), high_m=high_m), state
        low_m = min(world.low_m, block.mean_m)
        return replace(world, down=world.down.add(current_ma, block.mean_m), low_m=low_m), state

    def recorded(self, state: StageState) -> tuple[Stretch, ...]:
        """Return the stroke."""
        if not self.records:
            return ()
        made = stretch(state.trail, Kind.STROKE, 0.0, self.rate_ma_per_s)
        return (replace(made, direction=1.0 if made.applied_ma[-1] > made.applied_ma[0] else -1.0),)


@dataclass(frozen=True, slots=True)
class SlideUp:
    """From below, slowly to a part of the way between the lowest and the highest place that the strokes reached."""

    part: float

    @property
    def doing(self) -> str:
        """What the stage does."""
        return f"moving to {self.part:.0%} of the way"

    def lasts_s(self, world: World) -> float:
        """Return the time of half a stroke."""
        return 0.75 * (world.limits.current_high_ma - world.limits.current_low_ma) / _MIDDLE_MA_PER_S

    def advance(self, world: World, state: StageState, observation: Observation) -> tuple[World, StageState]:
        """Return world and state after an observation."""
        state = state.observed(observation)
        assert state.smooth_m is not None  # noqa: S101 - it has been observed
        place_m = world.low_m + self.part * (world.high_m - world.low_m)
        if state.smooth_m < place_m and state.current_ma < world.limits.current_high_ma:
            high_ma = world.limits.current_high_ma
            current_ma = world.towards(state.current_ma, high_ma, _MIDDLE_MA_PER_S, observation.elapsed_s)
            return world, replace(state, current_ma=current_ma)
        return world, replace(state, current_ma=world.within(world.line.balance_ma(state.smooth_m)), done=True)

    def recorded(self, state: StageState) -> tuple[Stretch, ...]:  # noqa: ARG002 - the interface's
        """Return nothing: the way shows nothing new."""
        return ()
