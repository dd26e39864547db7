"""The pressure of the actuator behind dead time, I/P converter, slew limit and lag, sample by sample. Pure.

    ẇ = (u(t - T_d) - w)/τ_c    and    ṗ = (w - p)/τ within ± the slew limit, τ = fill or vent by the sign of w - p

as in `valve.actuator`, pressures in mA. Within a step the mean of the converter's output is held, so each step is exact
for one of the two lags alone. A step is about a fifth of the shortest lag, but there are at most twenty in a sample.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.values import dataclass, replace
from positioner.valve.actuator import left_of_lag

if TYPE_CHECKING:
    from positioner.valve.actuator import ActuatorParameters

_SHORTEST_S = 1e-4
_OF_LAG = 0.2
_MOST_STEPS = 20
_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class PressureState:
    """The commands on their way, the oldest first, the converter's output w and the pressure p, all in mA."""

    line_ma: tuple[float, ...]
    converter_ma: float
    pressure_ma: float


@dataclass(frozen=True, slots=True)
class PressureModel:
    """The constants of one sample.

    delay_s: from a reading until its command acts on the valve; waiting: that and the dead time in samples, rounded up;
    early: the part of a sample by which a command acts before that. steps: of each sample; step_s: h, their length.
    lag_s: τ_c + τ_f. converter, fill, vent: what a step leaves of a difference, e^(-h/τ), 0 without lag. most_ma: the
    largest change of the pressure in a step, 0 is no limit.
    """

    delay_s: float
    waiting: int
    early: float
    steps: int
    step_s: float
    lag_s: float
    converter: float
    fill: float
    vent: float
    most_ma: float

    def at_rest(self, current_ma: float) -> PressureState:
        """Return the state in which this current has acted for long."""
        return PressureState((current_ma,) * self.waiting, current_ma, current_ma)

    def with_lag(self, lag_s: float) -> PressureModel:
        """Return the model whose pressure rises with this lag τ_c + τ_f; the other lags change in proportion."""
        if lag_s == self.lag_s:
            return self
        if self.lag_s == 0.0 or lag_s == 0.0:
            left = left_of_lag(self.step_s, lag_s)
            return replace(self, converter=0.0, fill=left, vent=left)
        power = self.lag_s / lag_s
        return replace(self, converter=self.converter**power, fill=self.fill**power, vent=self.vent**power)

    def with_dead_time(self, dead_time_s: float) -> PressureModel:
        """Return the model with this dead time T_d."""
        samples = (dead_time_s + self.delay_s) / (self.steps * self.step_s)
        waiting = math.ceil(samples - _ROUNDING)
        early = max(waiting - samples, 0.0)
        is_same = waiting == self.waiting and early == self.early
        return self if is_same else replace(self, waiting=waiting, early=early)

    def waiting_ma(self, state: PressureState) -> tuple[float, ...]:
        """Return the commands that wait, the oldest first, also where the state is that of another dead time.

        Those that wait no longer are forgotten; before the oldest one that is known, the converter's current was sent.
        """
        missing = self.waiting - len(state.line_ma)
        return (*(state.converter_ma,) * missing, *state.line_ma[max(-missing, 0) :]) if missing else state.line_ma

    def after(self, state: PressureState, current_ma: float) -> PressureState:
        """Return the state one sample later, if this current is commanded at its beginning."""
        line_ma = self.waiting_ma(state)
        if line_ma:
            line_ma, current_ma = self.acting(line_ma, current_ma)
        converter_ma, pressure_ma = self.under(current_ma, state.converter_ma, state.pressure_ma)
        return PressureState(line_ma, converter_ma, pressure_ma)

    def acting(self, line_ma: tuple[float, ...], current_ma: float) -> tuple[tuple[float, ...], float]:
        """Return what waits after a sample in which a current is commanded, and the mean of what acts in it."""
        waits_ma = (*line_ma[1:], current_ma)
        return waits_ma, line_ma[0] + self.early * (waits_ma[0] - line_ma[0])

    def under(self, current_ma: float, converter_ma: float, pressure_ma: float) -> tuple[float, float]:
        """Return the outputs of converter and chamber in mA after a sample under a current that acts at once."""
        for _step in range(self.steps):
            before_ma, converter_ma = converter_ma, current_ma + (converter_ma - current_ma) * self.converter
            driving_ma = 0.5 * (before_ma + converter_ma) if self.converter > 0.0 else converter_ma
            gap_ma = driving_ma - pressure_ma
            step_ma = gap_ma * (1.0 - (self.fill if gap_ma > 0.0 else self.vent))
            if self.most_ma > 0.0:
                step_ma = min(max(step_ma, -self.most_ma), self.most_ma)
            pressure_ma += step_ma
        return converter_ma, pressure_ma


def pressure_model(actuator: ActuatorParameters, period_s: float, delay_s: float = 0.0) -> PressureModel:
    """Return the model for samples of this period; `delay_s` passes from a reading until its command acts."""
    lags_s = (actuator.converter_time_constant_s, actuator.fill_time_constant_s, actuator.vent_time_constant_s)
    present_s = [lag_s for lag_s in lags_s if lag_s > 0.0]
    steps = 1
    if present_s or actuator.slew_ma_per_s:
        longest_s = max(_OF_LAG * min(present_s, default=period_s), _SHORTEST_S)
        steps = max(1, min(_MOST_STEPS, int(period_s / longest_s)))
    step_s = period_s / steps
    converter, fill, vent = (left_of_lag(step_s, lag_s) for lag_s in lags_s)
    most_ma, lag_s = actuator.slew_ma_per_s * step_s, actuator.lag_s(fills=True)
    at_once = PressureModel(delay_s, 0, 0.0, steps, step_s, lag_s, converter, fill, vent, most_ma)
    return at_once.with_dead_time(actuator.dead_time_s)
