"""The parameters of what lies between the loop current and the pressure at the diaphragm. Pure.

After the dead time the I/P converter follows the current with a lag of its own, and the pressure follows the converter,
    ẇ = (u(t - T_d) - w)/τ_c    and    ṗ = (w - p)/τ within ± the slew limit, τ = fill or vent by the sign of w - p.
Pressure is carried in mA: the current that would hold it, so that its force is B·p. All 0 is the paper's actuator,
whose pressure is the current at once (eq. 10).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated

from annotated_types import Interval

from positioner.inputs.table import SettingsTable


@dataclass(frozen=True, slots=True, kw_only=True)
class ActuatorParameters(SettingsTable):
    """The `[valve.actuator]` table of a configuration.

    fill_time_constant_s, vent_time_constant_s: τ, lag of the pressure while it rises, and while it falls; 0 is none.
    dead_time_s: T_d, from the instant at which a command acts until the converter begins to follow it.
    slew_ma_per_s: the fastest change of the pressure; 0 is no limit.
    converter_time_constant_s: τ_c, the lag of the I/P converter.
    """

    fill_time_constant_s: Annotated[float, Interval(ge=0.0, le=60.0)] = 0.0
    vent_time_constant_s: Annotated[float, Interval(ge=0.0, le=60.0)] = 0.0
    dead_time_s: Annotated[float, Interval(ge=0.0, le=10.0)] = 0.0
    slew_ma_per_s: Annotated[float, Interval(ge=0.0, le=1e6)] = 0.0
    converter_time_constant_s: Annotated[float, Interval(ge=0.0, le=10.0)] = 0.0

    def __post_init__(self) -> None:
        """Refuse combinations that the limits of the single keys allow."""
        if (self.fill_time_constant_s == 0.0) != (self.vent_time_constant_s == 0.0):
            given, other = "fill_time_constant_s", "vent_time_constant_s"
            if self.fill_time_constant_s == 0.0:
                given, other = other, given
            raise ValueError(f"{given} needs {other}, too: a line that fills slowly also vents slowly")

    @property
    def is_immediate(self) -> bool:
        """Whether the pressure is the current at once."""
        lags_s = (self.fill_time_constant_s, self.vent_time_constant_s, self.dead_time_s)
        return lags_s == (0.0, 0.0, 0.0) and self.slew_ma_per_s == 0.0 and self.converter_time_constant_s == 0.0

    def with_lag(self, lag_s: float) -> ActuatorParameters:
        """Return the actuator whose pressure rises with this lag τ_c + τ_f; the other lags change in proportion."""
        told_s = self.lag_s(fills=True)
        if told_s == 0.0:
            return replace(self, fill_time_constant_s=lag_s, vent_time_constant_s=lag_s)
        times = lag_s / told_s
        return replace(
            self,
            fill_time_constant_s=times * self.fill_time_constant_s,
            vent_time_constant_s=times * self.vent_time_constant_s,
            converter_time_constant_s=times * self.converter_time_constant_s,
        )

    def own_lag_s(self, *, fills: bool) -> float:
        """τ_f or τ_v."""
        return self.fill_time_constant_s if fills else self.vent_time_constant_s

    def lag_s(self, *, fills: bool) -> float:
        """τ_f or τ_v, and τ_c before it."""
        return self.own_lag_s(fills=fills) + self.converter_time_constant_s

    @property
    def slower_lag_s(self) -> float:
        """The longer one of τ_f and τ_v, and τ_c behind it."""
        return max(self.fill_time_constant_s, self.vent_time_constant_s) + self.converter_time_constant_s

    def in_words(self) -> str:
        """Return the lags in ms and the slew limit in mA/s, in one line."""
        if self.is_immediate:
            return "acts at once"
        parts = (
            ("fill", self.fill_time_constant_s * 1e3, "ms"),
            ("vent", self.vent_time_constant_s * 1e3, "ms"),
            ("dead time", self.dead_time_s * 1e3, "ms"),
            ("I/P lag", self.converter_time_constant_s * 1e3, "ms"),
            ("slew limit", self.slew_ma_per_s, "mA/s"),
        )
        return ", ".join(f"{name} {value:g} {unit}" for name, value, unit in parts if value)


def left_of_lag(elapsed_s: float, lag_s: float) -> float:
    """Return what a lag leaves of a difference, e^(-t/τ)."""
    return math.exp(-elapsed_s / lag_s) if lag_s > 0.0 else 0.0
