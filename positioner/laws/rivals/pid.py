"""A PI controller with filtered derivative and anti-windup, in the position form (Åström and Hägglund 2006, §3). Pure.

    u_c = K_p (r - y_f) + I - K_d dy_f/dt,    dI/dt = K_i (r - y_f) unless u_c is at a limit and would go beyond it

y_f is the reading behind a first-order filter. The derivative acts on the position alone: a new setpoint is no kick.
"""

from __future__ import annotations

from typing import Annotated

from annotated_types import Interval

from positioner.inputs.table import SettingsTable
from positioner.laws.rivals.model_free import smooth
from positioner.values import dataclass, replace


@dataclass(frozen=True, slots=True, kw_only=True)
class PidSettings(SettingsTable):
    """Gains; they belong together, so a table names all of them.

    proportional_gain_ma_per_m: K_p, current per error.
    integral_gain_ma_per_m_s: K_i, current per error and time.
    derivative_gain_ma_s_per_m: K_d, current per change of the reading.
    filter_time_constant_s: T_f, filter of the reading; 0 leaves it as it is.
    """

    proportional_gain_ma_per_m: Annotated[float, Interval(ge=0.0, le=1e5)]
    integral_gain_ma_per_m_s: Annotated[float, Interval(ge=0.0, le=1e7)]
    derivative_gain_ma_s_per_m: Annotated[float, Interval(ge=0.0, le=1e4)]
    filter_time_constant_s: Annotated[float, Interval(ge=0.0, le=60.0)]


@dataclass(frozen=True, slots=True)
class PidMemory:
    """The filter's output and its rate of change, and the integral I in mA."""

    position_m: float
    speed_m_per_s: float
    integral_ma: float


@dataclass(frozen=True, slots=True)
class PidController:
    """The controller; the limits are those of the loop, for the anti-windup."""

    settings: PidSettings
    current_low_ma: float
    current_high_ma: float

    def begin(self, measured_m: float, output_ma: float) -> PidMemory:
        """Return the memory whose output without error is `output_ma`, as far as the loop carries that."""
        return PidMemory(measured_m, 0.0, min(max(output_ma, self.current_low_ma), self.current_high_ma))

    def see(self, memory: PidMemory, measured_m: float, elapsed_s: float) -> PidMemory:
        """Return the memory with the reading in its filter."""
        position_m = smooth(memory.position_m, measured_m, self.settings.filter_time_constant_s, elapsed_s)
        speed_m_per_s = (position_m - memory.position_m) / elapsed_s
        return replace(memory, position_m=position_m, speed_m_per_s=speed_m_per_s)

    def output(self, memory: PidMemory, setpoint_m: float, elapsed_s: float) -> tuple[PidMemory, float]:
        """Return the memory, integrated over `elapsed_s`, and u_c in mA; u_c is not limited."""
        gains = self.settings
        error_m = setpoint_m - memory.position_m
        output_ma = (
            gains.proportional_gain_ma_per_m * error_m
            + memory.integral_ma
            - gains.derivative_gain_ma_s_per_m * memory.speed_m_per_s
        )
        saturates = output_ma >= self.current_high_ma if error_m > 0.0 else output_ma <= self.current_low_ma
        if saturates:
            return memory, output_ma
        integral_ma = memory.integral_ma + gains.integral_gain_ma_per_m_s * error_m * elapsed_s
        return replace(memory, integral_ma=integral_ma), output_ma
