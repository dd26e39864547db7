"""The knocker: short pulses that shake the stem loose (Hägglund 2002, J. Process Control 12, 897-904). Pure.

    u = u_c + a sign(u_c(t_p) - u_c(t_p - h_k))   for t_p <= t < t_p + τ,   u = u_c   until the next pulse at t_p + h_k

A pulse has the direction in which the controller's output has changed since the last pulse. No pulse begins while the
error is inside the off-band, so that a stem close to its setpoint is not disturbed.
"""

from __future__ import annotations

import math
from typing import Annotated

from annotated_types import Interval

from positioner.inputs.table import SettingsTable
from positioner.laws.rivals.pid import PidSettings  # noqa: TC001 - pydantic reads this hint at run time
from positioner.values import dataclass, replace

_INSTANT_S = 1e-9
"""Rounding of a sum of periods."""


@dataclass(frozen=True, slots=True, kw_only=True)
class KnockerSettings(SettingsTable):
    """The `[control.knocker]` table: the controller and its pulses.

    pid: the controller's gains.
    pulse_amplitude_ma, pulse_width_s, pulse_period_s: a, τ and h_k, the pulses that are added to the current.
    off_band_m: error below which no pulse begins; 0 knocks always.
    """

    pid: PidSettings
    pulse_amplitude_ma: Annotated[float, Interval(ge=0.0, le=16.0)]
    pulse_width_s: Annotated[float, Interval(gt=0.0, le=60.0)]
    pulse_period_s: Annotated[float, Interval(gt=0.0, le=600.0)]
    off_band_m: Annotated[float, Interval(ge=0.0, le=0.1)]

    def __post_init__(self) -> None:
        """Refuse a pulse that is longer than its period."""
        if self.pulse_width_s > self.pulse_period_s:
            raise ValueError("pulse_width_s must not exceed pulse_period_s: pulses would overlap")


@dataclass(frozen=True, slots=True)
class KnockerMemory:
    """The pulse in mA that began last, its age, and the controller's output at that time."""

    pulse_ma: float
    age_s: float
    output_ma: float


@dataclass(frozen=True, slots=True)
class Knocker:
    """The compensator."""

    settings: KnockerSettings

    def begin(self, output_ma: float) -> KnockerMemory:
        """Return the memory of the start: the first pulse comes after one period, if the output has changed by then."""
        return KnockerMemory(0.0, 0.0, output_ma)

    def add(
        self, memory: KnockerMemory, output_ma: float, error_m: float, elapsed_s: float
    ) -> tuple[KnockerMemory, float]:
        """Return the memory and the pulse in mA, 0 between pulses."""
        pulses = self.settings
        age_s = memory.age_s + elapsed_s
        if age_s < pulses.pulse_period_s - _INSTANT_S:
            ends = age_s >= pulses.pulse_width_s - _INSTANT_S
            memory = replace(memory, pulse_ma=0.0 if ends else memory.pulse_ma, age_s=age_s)
            return memory, memory.pulse_ma
        change_ma = output_ma - memory.output_ma
        knocks = change_ma != 0.0 and abs(error_m) >= pulses.off_band_m
        pulse_ma = math.copysign(pulses.pulse_amplitude_ma, change_ma) if knocks else 0.0
        return KnockerMemory(pulse_ma=pulse_ma, age_s=0.0, output_ma=output_ma), pulse_ma
