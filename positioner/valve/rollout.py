"""How a stem moves under commanded currents: the pressure follows them, frees the stem, moves and stops it. Pure.

    ṗ as in `valve.pressure`
    stuck:    x stays while |B p - K x - F_0| ≤ F_s
    sliding:  m v̇ = B p - K x - F_0 - s F_c - F_v v, s = ±1, until v = 0 (`valve.motion`, exact for a held pressure)

A sample is divided into steps in which the mean of the pressure is held. A step in which the stem is freed counts from
that instant on, as the exponential of the lag has it, so the place of a stop has no jumps of a step.
"""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING

from positioner.values import dataclass
from positioner.valve.motion import Load, MotionModel
from positioner.valve.pressure import pressure_model
from positioner.valve.slide import Slide, slide_of
from positioner.valve.state import StemState

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from positioner.valve.parameters import ValveParameters
    from positioner.valve.pressure import PressureModel, PressureState

_STEP_S = 1e-3
"""A fifth of √(m/K) of the paper's valve, and less than a lag that matters."""
_NEARLY_ONE = 0.999
"""Of a longer lag the mean is a half to 1e-4, and the difference of two large numbers would say so no better."""


@dataclass(frozen=True, slots=True)
class Numbers:
    """What a move depends on: K/B in mA/m, F_0/B, F_c/B and F_s/B in mA.

    lag_s: τ_c + τ_f, that of the rising pressure; dead_time_s: T_d. viscous: above 0, a factor of the configured F_v.
    """

    spring_ma_per_m: float
    offset_ma: float
    sliding_ma: float
    static_ma: float
    lag_s: float
    dead_time_s: float
    viscous: float = 1.0

    @property
    def jump_m(self) -> float:
        """The slip jump (F_s - F_c)/K."""
        return (self.static_ma - self.sliding_ma) / self.spring_ma_per_m

    def balance_ma(self, position_m: float) -> float:
        """Return k x + c: the middle of the stick band."""
        return self.spring_ma_per_m * position_m + self.offset_ma


@dataclass(frozen=True, slots=True)
class Moving:
    """A stem and the pressure that moves it, in steps of the `Plant`; shift_ma: what pushes it upwards in this slip."""

    pressure: PressureState
    stem: StemState
    shift_ma: float = 0.0


@dataclass(frozen=True, slots=True)
class Plant:
    """The configured valve, as far as `Numbers` do not say it.

    mass, viscous: m/B and F_v/B, in mA s²/m and mA s/m. actuator: in steps of `step_s`, of which a sample has `steps`.
    """

    mass: float
    viscous: float
    actuator: PressureModel
    steps: int
    step_s: float

    def rollout(self, numbers: Numbers) -> Rollout:
        """Return the motion of the valve that has these numbers."""
        pressure = self.actuator.with_lag(numbers.lag_s).with_dead_time(numbers.dead_time_s)
        filling, venting = (_within_step(left**pressure.steps, pressure) for left in (pressure.fill, pressure.vent))
        motion = MotionModel(self.mass, 1.0, numbers.offset_ma)
        load = Load(numbers.spring_ma_per_m, numbers.sliding_ma, self.viscous * numbers.viscous)
        up, down = (slide_of(motion, load, direction, self.step_s) for direction in (1.0, -1.0))
        return Rollout(pressure, self.steps, numbers, up, down, filling, venting)


@dataclass(frozen=True, slots=True)
class WithinStep:
    """How the pressure changes within a step h: left: e^(-h/τ), 1 for a straight line.

    part_of_mean: (mean - before)/(after - before).
    """

    left: float
    part_of_mean: float

    def rest_of(self, share: float) -> tuple[float, float]:
        """Return the part of a step after this share of its change, and the part of the rest's change in its mean.

        share: from 0 to below 1. By p(t) - before = change (1 - e^(-t/τ))/(1 - e^(-h/τ)).
        """
        if self.left >= 1.0:
            return 1.0 - share, 0.5
        if self.left <= 0.0:
            return 1.0, 1.0
        part = 1.0 - math.log(1.0 - share * (1.0 - self.left)) / math.log(self.left)
        return part, _part_of_mean(self.left**part)


@dataclass(frozen=True, slots=True)
class Rollout:
    """The motion of a valve, sample by sample; filling, venting: the pressure within a step."""

    pressure: PressureModel
    steps: int
    numbers: Numbers
    up: Slide
    down: Slide
    filling: WithinStep
    venting: WithinStep

    def after(self, moving: Moving, current_ma: float) -> Moving:
        """Return the motion one sample later, if this current is commanded at its beginning."""
        pressure, stem, shift_ma = moving.pressure, moving.stem, moving.shift_ma
        x, v, is_stuck, direction = stem.position_m, stem.velocity_m_per_s, stem.stuck, stem.direction
        for _step in range(self.steps):
            before_ma = pressure.pressure_ma
            pressure = self.pressure.after(pressure, current_ma)
            x, v, is_stuck, direction = self._moved(
                x, v, is_stuck, direction, before_ma + shift_ma, pressure.pressure_ma + shift_ma
            )
        return Moving(pressure, StemState(x, v, is_stuck, direction), shift_ma)

    def places_m(self, moving: Moving, runs: Sequence[tuple[float, int]]) -> list[float]:
        """Return where the stem is after each sample under currents in mA, each for so many samples.

        It is the motion of `after`, without a value for each sample: a study plays thousands of them.
        """
        line_ma, converter_ma = self.pressure.waiting_ma(moving.pressure), moving.pressure.converter_ma
        pressure_ma, shift_ma, found = moving.pressure.pressure_ma, moving.shift_ma, list[float]()
        stem = moving.stem
        x, v, is_stuck, direction = stem.position_m, stem.velocity_m_per_s, stem.stuck, stem.direction
        for current_ma, count in runs:
            earlier = self.pressure.waiting  # steps in which earlier currents act; then nothing else waits
            for _sample in range(count):
                for _step in range(self.steps):
                    acting_ma, before_ma = current_ma, pressure_ma
                    if earlier > 0:
                        earlier -= 1
                        line_ma, acting_ma = self.pressure.acting(line_ma, current_ma)
                    converter_ma, pressure_ma = self.pressure.under(acting_ma, converter_ma, pressure_ma)
                    x, v, is_stuck, direction = self._moved(
                        x, v, is_stuck, direction, before_ma + shift_ma, pressure_ma + shift_ma
                    )
                found.append(x)
        return found

    def path(self, moving: Moving, currents: Sequence[float]) -> Iterator[Moving]:
        """Yield the motion after each sample under these currents, of which the last one stays."""
        for sample in itertools.count():
            moving = self.after(moving, currents[min(sample, len(currents) - 1)])
            yield moving

    def _moved(
        self, x: float, v: float, is_stuck: bool, direction: float, before_ma: float, after_ma: float
    ) -> tuple[float, float, bool, float]:
        """Return position, speed, whether it is stuck, and direction of a stem after a step between two pressures."""
        numbers = self.numbers
        within = self.filling if after_ma > before_ma else self.venting
        mean_ma = before_ma + within.part_of_mean * (after_ma - before_ma)
        if is_stuck:
            balance_ma = numbers.balance_ma(x)
            push_ma = after_ma - balance_ma
            if abs(push_ma) <= numbers.static_ma:
                return x, v, True, direction
            direction = 1.0 if push_ma > 0.0 else -1.0
            held_ma = numbers.static_ma - direction * (before_ma - balance_ma)
            slide = self.up if direction > 0.0 else self.down
            if held_ma > 0.0:
                at_ma = balance_ma + direction * numbers.static_ma
                part, part_of_mean = within.rest_of(held_ma / (direction * (after_ma - before_ma)))
                mean_ma = at_ma + part_of_mean * (after_ma - at_ma)
                end = slide.model.step(x, 0.0, mean_ma, slide.load, direction, part * slide.period_s)
                return end.x, end.v, end.stopped, direction
        slide = self.up if direction > 0.0 else self.down
        x, v = slide.after(x, v, mean_ma)
        return x, v, direction * v <= 0.0, direction


def _within_step(left: float, pressure: PressureModel) -> WithinStep:
    """Return how the pressure changes in a step that leaves `left`; in a line, where it follows no one exponential."""
    is_exponential = pressure.converter == 0.0 and pressure.most_ma == 0.0
    return WithinStep(left, _part_of_mean(left)) if is_exponential else WithinStep(1.0, 1.0 if left <= 0.0 else 0.5)


def _part_of_mean(left: float) -> float:
    """Return (mean - before)/(after - before) of e^(-t/τ) over a time that leaves e^(-h/τ): 1/(1 - e^(-h/τ)) - τ/h."""
    if left <= 0.0:
        return 1.0
    return 1.0 / (1.0 - left) + 1.0 / math.log(left) if left < _NEARLY_ONE else 0.5


def plant_of(valve: ValveParameters, period_s: float, delay_s: float) -> Plant:
    """Return the configured valve; `delay_s` passes from a reading until its command acts."""
    steps = max(1, math.ceil(period_s / _STEP_S - 1e-9))
    gain = valve.force_gain_n_per_ma
    actuator = pressure_model(valve.actuator, period_s / steps, delay_s)
    return Plant(valve.mass_kg / gain, valve.viscous_friction_n_s_per_m / gain, actuator, steps, period_s / steps)
