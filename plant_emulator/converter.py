"""The I/P converter's imperfections: an offset, hysteresis, a dead band, a supply that ends. Pure.

Hysteresis is play: the output stays until the input is half its width away. The dead band holds the output until the
input has changed by its width, and then takes the input. The current is constant between two edges, so both act there.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.values import dataclass

if TYPE_CHECKING:
    from plant_emulator.parameters import ActuatorSettings, PlantSettings


@dataclass(frozen=True, slots=True)
class Converted:
    """The current in mA behind the hysteresis, and behind the dead band."""

    played_ma: float
    passed_ma: float


def converted(settings: ActuatorSettings, before: Converted, current_ma: float) -> Converted:
    """Return what passes of a loop current of `current_ma`."""
    if settings.hysteresis_ma == settings.dead_band_ma == settings.offset_ma == 0.0:
        return before if before.passed_ma == current_ma else Converted(current_ma, current_ma)
    centre_ma, half_ma = shifted_ma(settings, current_ma), 0.5 * settings.hysteresis_ma
    played_ma = min(max(before.played_ma, centre_ma - half_ma), centre_ma + half_ma)
    if abs(played_ma - before.passed_ma) < settings.dead_band_ma:
        return Converted(played_ma, before.passed_ma)
    return Converted(played_ma, played_ma)


def shifted_ma(settings: ActuatorSettings, current_ma: float) -> float:
    """Return `current_ma` with the offset; an offset takes nothing away below 0 mA."""
    return current_ma if settings.offset_ma == 0.0 else max(current_ma + settings.offset_ma, 0.0)


def pressure_pa(settings: PlantSettings, passed_ma: float) -> float:
    """Return the pressure that the converter makes of a current of `passed_ma`, as far as its supply reaches."""
    wanted_pa, supply_pa = settings.valve.pressure_gain_pa_per_ma * passed_ma, settings.actuator.supply_pa
    return min(wanted_pa, supply_pa) if supply_pa > 0.0 else wanted_pa
