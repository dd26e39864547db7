"""Dry friction (paper eqs 3-5), and how it varies with the position, from stop to stop, with wear and rest. Pure.

Deviation from the paper: its eq. 4 has e^(+(v/V_s)²), which grows without bound. Stribeck's curve is e^(-(v/V_s)²).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from plant_emulator.ageing import growth
from plant_emulator.draws import Stream, uniform
from positioner.values import dataclass, replace

if TYPE_CHECKING:
    from plant_emulator.parameters import PlantSettings

CELL_WIDTH_M = 0.00025
"""Friction is constant inside a cell, so that the motion there keeps its closed form."""

_LEAST_WEAR = 0.05
"""Wear leaves at least this part of the friction."""
_HOUR_S = 3600.0

_WAVELENGTHS_M = (0.011, 0.0037)
"""Of the two waves of the friction field; with their ratio no two strokes are alike."""


@dataclass(frozen=True, slots=True)
class Drifted:
    """The drift of F_s and F_c that had come together, as a fraction of both, after so many stops, at a plant time."""

    fraction: float
    stops: int
    time_s: float


NOT_DRIFTED = Drifted(0.0, 0, 0.0)


@dataclass(frozen=True, slots=True)
class Packing:
    """Dry friction at the present position: F_s and F_c, the cell of the field, and what they follow from.

    seed, draw: the random numbers behind them.
    wear: the factor by which moves and time have changed both.
    rested_s: the time of rest since the stem last left the zero-speed band.
    one_way_n: by how much the friction of opening is larger than F_s or F_c, and that of closing smaller.
    drifted: the drift up to the last change of the settings.
    """

    static_n: float
    coulomb_n: float
    cell: int
    seed: int
    draw: float
    wear: float = 1.0
    rested_s: float = 0.0
    one_way_n: float = 0.0
    drifted: Drifted = NOT_DRIFTED


def stribeck_n(speed_m_per_s: float, static_n: float, coulomb_n: float, stribeck_velocity_m_per_s: float) -> float:
    """Return γ of eq. 4 in N, the dry friction at a speed of at least DV."""
    ratio = speed_m_per_s / stribeck_velocity_m_per_s
    return coulomb_n + (static_n - coulomb_n) * math.exp(-ratio * ratio)


def initial_packing(settings: PlantSettings, seed: int) -> Packing:
    """Return the friction at the start of a plant."""
    cell = math.floor(settings.valve.initial_position_m / CELL_WIDTH_M)
    draw = uniform(seed, Stream.FRICTION, 1)
    return _packed(settings, Packing(0.0, 0.0, cell, seed, draw))


def after_crossing(settings: PlantSettings, packing: Packing, direction: int) -> Packing:
    """Return the friction in the next cell in `direction`, +1 or -1."""
    return _packed(settings, replace(packing, cell=packing.cell + direction))


def after_stop(settings: PlantSettings, packing: Packing, stops: int, time_s: float = 0.0) -> Packing:
    """Return the friction after stop number `stops` at plant time `time_s`: a new random half, and more wear."""
    drift = _drift(settings, packing.drifted, stops, time_s)
    if settings.stochastic.friction_fraction == 0.0 and drift == 0.0:
        return packing
    draw, wear = uniform(packing.seed, Stream.FRICTION, stops + 1), max(1.0 + drift, _LEAST_WEAR)
    return _packed(settings, replace(packing, draw=draw, wear=wear))


def after_rest(settings: PlantSettings, packing: Packing, duration_s: float) -> Packing:
    """Return the friction after `duration_s` more of rest."""
    return _packed(settings, replace(packing, rested_s=packing.rested_s + duration_s))


def after_leaving(settings: PlantSettings, packing: Packing) -> Packing:
    """Return the friction of a stem that has left the zero-speed band, which ends the growth of F_s."""
    return packing if packing.rested_s == 0.0 else _packed(settings, replace(packing, rested_s=0.0))


def repacked(before: PlantSettings, after: PlantSettings, packing: Packing, stops: int, time_s: float) -> Packing:
    """Return the friction after the settings changed at `time_s`, after `stops` stops; the drift goes on from there."""
    fraction = _drift(before, packing.drifted, stops, time_s)
    return _packed(after, replace(packing, drifted=Drifted(fraction, stops, time_s)))


def _drift(settings: PlantSettings, since: Drifted, stops: int, time_s: float) -> float:
    """Return the drift as a fraction of F_s and F_c."""
    moved = settings.packing.drift_per_move * (stops - since.stops)
    return since.fraction + moved + settings.packing.drift_per_hour * (time_s - since.time_s) / _HOUR_S


def _packed(settings: PlantSettings, packing: Packing) -> Packing:
    fraction = settings.stochastic.friction_fraction
    phase = math.pi * uniform(packing.seed, Stream.FRICTION, 0)
    common = settings.packing.friction_factor * packing.wear
    factor = common * (1.0 + fraction * 0.5 * (_field(packing.cell, phase) + packing.draw))
    one_way_n, waves = 0.0, settings.packing
    if waves.varies_by_place:
        phase = math.tau * (packing.cell + 0.5) * CELL_WIDTH_M / waves.place_period_m
        factor *= 1.0 + waves.place_fraction * math.sin(phase)
        one_way_n = waves.direction_fraction * settings.valve.static_friction_n * common * math.cos(phase)
    static_n, coulomb_n = settings.valve.static_friction_n * factor, settings.valve.coulomb_friction_n * factor
    if packing.rested_s > 0.0:
        static_n *= 1.0 + growth(settings.packing, packing.rested_s)
    return replace(packing, static_n=static_n, coulomb_n=coulomb_n, one_way_n=one_way_n)


def _field(cell: int, phase: float) -> float:
    """Return the value of the friction field in a cell, from -1 to 1."""
    centre_m = (cell + 0.5) * CELL_WIDTH_M
    long, short = _WAVELENGTHS_M
    return 0.5 * math.sin(math.tau * centre_m / long + phase) + 0.5 * math.sin(
        math.tau * centre_m / short + 2.3 * phase
    )
