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

    waiting: samples of dead time, rounded up. steps: of each sample; step_s: h, their length. lag_s: τ_c + τ_f.
    converter, fill, vent: what a step leaves of a difference, e^(-h/τ), 0 without lag. most_ma: the largest change of
    the pressure in a step, 0 is no limit.
    """

    waiting: int
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

    def from_longer(self, state: PressureState, times: int) -> PressureState:
        """Return the state of a model of the same valve whose samples are so many times as long.

        That one rounds the dead time up to its own samples, so by this one the pressure has come farther.
        """
        line_ma = tuple([current_ma for current_ma in state.line_ma for _ in range(times)])
        acted, arrived = len(line_ma) - self.waiting, replace(state, line_ma=())
        for current_ma in line_ma[:acted]:
            arrived = self.after(arrived, current_ma)
        return replace(arrived, line_ma=line_ma[acted:])

    def after(self, state: PressureState, current_ma: float) -> PressureState:
        """Return the state one sample later, if this current is commanded at its beginning."""
        line_ma = state.line_ma
        if line_ma:
            line_ma, current_ma = (*line_ma[1:], current_ma), line_ma[0]
        converter_ma, pressure_ma = self.under(current_ma, state.converter_ma, state.pressure_ma)
        return PressureState(line_ma, converter_ma, pressure_ma)

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
    waiting = math.ceil((actuator.dead_time_s + delay_s) / period_s - _ROUNDING)
    most_ma = actuator.slew_ma_per_s * step_s
    return PressureModel(waiting, steps, step_s, actuator.lag_s(fills=True), converter, fill, vent, most_ma)
