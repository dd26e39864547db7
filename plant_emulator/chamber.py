"""The pressure in the diaphragm chamber behind an I/P converter with a lag, and with a limited slew rate. Pure.

    q̇ = (w - q)/τ₂,   ṗ = (q - p)/τ within ± r

w is the commanded pressure, q that of the converter, p that of the chamber; τ is the time constant of filling while
q > p, else that of venting. Between the edges of w the pressure passes few phases, each with a closed form: p follows
freely, by two exponentials at most, or changes at the rate r.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from plant_emulator.roots import TIME_TOLERANCE_S, crossing
from positioner.values import dataclass

if TYPE_CHECKING:
    from plant_emulator.parameters import ActuatorSettings

_APART = 1e-4
"""Relative distance that is kept between two time constants: the closed form of equal ones is another."""

_EQUAL, _EQUAL_PA = 1e-10, 1e-9
"""Relative to the pressures, and in Pa: a smaller difference of two of them is a rounding error."""


@dataclass(frozen=True, slots=True)
class Phase:
    """The pressure final_pa + ramp_pa_per_s·t + Σ deviation·e^(-rate·t), for `duration_s`."""

    duration_s: float
    final_pa: float
    decays: tuple[tuple[float, float], ...] = ()
    ramp_pa_per_s: float = 0.0

    def at(self, time_s: float) -> float:
        """Return the pressure in Pa, `time_s` after the start of the phase."""
        pressure_pa = self.final_pa + self.ramp_pa_per_s * time_s
        for deviation_pa, rate_per_s in self.decays:
            pressure_pa += deviation_pa * math.exp(-rate_per_s * time_s)
        return pressure_pa


def phases(
    settings: ActuatorSettings, chamber_pa: float, converter_pa: float, target_pa: float, duration_s: float
) -> tuple[tuple[Phase, ...], float, float]:
    """Return the phases of the chamber's pressure, and the pressures of chamber and converter after them, in Pa."""
    found: list[Phase] = []
    left_s, p = duration_s, chamber_pa
    q = converter_pa if settings.converter_time_constant_s else target_pa
    while left_s > 0.0:
        phase = _next(settings, p, q, target_pa, left_s)
        found.append(phase)
        left_s -= phase.duration_s
        p, q = phase.at(phase.duration_s), _converter_at(settings, p, q, target_pa, phase.duration_s)
    return tuple(found), p, q


def _converter_at(settings: ActuatorSettings, p: float, q: float, target: float, time_s: float) -> float:
    lag_s = _converter_lag_s(settings, _lag_s(settings, _way(settings, p, q, target)))
    return target + (q - target) * math.exp(-time_s / lag_s) if lag_s else target


def _way(settings: ActuatorSettings, p: float, q: float, target: float) -> int:
    """Return 1 where the chamber fills, -1 where it vents, 0 where nothing changes."""
    driving = target - q if abs(q - p) <= _tolerance_pa(settings, p, q, target) else q - p
    return (driving > 0.0) - (driving < 0.0)


def _tolerance_pa(settings: ActuatorSettings, p: float, q: float, target: float) -> float:
    """Return the difference in Pa that counts as none: of rounding, and of instants that are located."""
    located_pa = 2.0 * TIME_TOLERANCE_S * settings.slew_pa_per_s
    return _EQUAL_PA + located_pa + _EQUAL * max(abs(p), abs(q), abs(target))


def _lasting(found_s: float, left_s: float) -> float:
    """Return the duration of a phase whose end was located at `found_s`; no phase is so short that no time passes."""
    return min(max(found_s, TIME_TOLERANCE_S), left_s)


def _lag_s(settings: ActuatorSettings, way: int) -> float:
    return settings.fill_time_constant_s if way > 0 else settings.vent_time_constant_s


def _converter_lag_s(settings: ActuatorSettings, chamber_lag_s: float) -> float:
    lag_s = settings.converter_time_constant_s
    return lag_s if abs(lag_s - chamber_lag_s) >= _APART * lag_s else (1.0 + _APART) * chamber_lag_s


def _next(settings: ActuatorSettings, p: float, q: float, target: float, left_s: float) -> Phase:
    """Return the phase that begins now; it ends with the time, a change of direction, or the slew limit."""
    way = _way(settings, p, q, target)
    if way == 0:
        return Phase(left_s, target)
    lag_s = _lag_s(settings, way)
    converter_s = _converter_lag_s(settings, lag_s)
    speed = (target - q) / converter_s if converter_s else 0.0
    slew = settings.slew_pa_per_s
    if slew > 0.0:
        beyond = way * (q - p) - slew * lag_s
        at_edge = abs(beyond) <= _tolerance_pa(settings, p, q, target)
        if (way * speed > slew) if at_edge else beyond > 0.0:
            ramp_s = _lasting(_ramp_s(p, q, target, converter_s, lag_s, way, slew, left_s), left_s)
            return Phase(ramp_s, p, (), way * slew)
    are_equal = abs(q - p) <= _tolerance_pa(settings, p, q, target)
    return _free(p, q, target, converter_s, lag_s, way, slew, left_s, are_equal=are_equal)


def _ramp_s(
    p: float, q: float, target: float, converter_s: float, lag_s: float, way: int, slew: float, left_s: float
) -> float:
    """Return how long the chamber needs the highest rate: until |q - p| falls to what the lag alone would follow."""
    if not converter_s:
        return (way * (target - p) - slew * lag_s) / slew

    def beyond(t: float) -> float:
        converter = target + (q - target) * math.exp(-t / converter_s)
        return way * (converter - p) - slew * (t + lag_s)

    speed = way * (target - q) / converter_s
    # while the converter is the faster one, the distance grows
    first_s = converter_s * math.log(speed / slew) if speed > slew else 0.0
    return left_s if first_s >= left_s or beyond(left_s) > 0.0 else crossing(beyond, first_s, left_s)


def _free(
    p: float,
    q: float,
    target: float,
    converter_s: float,
    lag_s: float,
    way: int,
    slew: float,
    left_s: float,
    *,
    are_equal: bool,
) -> Phase:
    """Return the phase without the limit of the rate."""
    if not converter_s:
        return Phase(left_s, target, ((p - target, 1.0 / lag_s),) if lag_s else ())
    if not lag_s:
        return Phase(left_s, target, ((q - target, 1.0 / converter_s),))
    slow = (q - target) * converter_s / (converter_s - lag_s)
    own = p - target - slow
    # q - p = a·e^(-t/τ₂) - b·e^(-t/τ)
    a, b, duration_s = q - target - slow, own, left_s
    spread = 1.0 / lag_s - 1.0 / converter_s
    turning_s = math.log(b / a) / spread if a * b > 0.0 else -1.0
    if 0.0 < turning_s < duration_s and not are_equal:
        duration_s = _lasting(turning_s, left_s)
    if slew > 0.0:
        largest_s = math.log(b * converter_s / (a * lag_s)) / spread if a * b > 0.0 else -1.0

        def beyond(t: float) -> float:
            return way * (a * math.exp(-t / converter_s) - b * math.exp(-t / lag_s)) - slew * lag_s

        latest_s = min(largest_s, duration_s)
        if latest_s > 0.0 and beyond(latest_s) > 0.0:
            duration_s = _lasting(crossing(beyond, 0.0, latest_s), left_s)
    return Phase(duration_s, target, ((slow, 1.0 / converter_s), (own, 1.0 / lag_s)))
