"""The constants of a valve's motion, computed once for each settings. Pure."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, ClassVar

from plant_emulator.oscillator import Oscillator
from plant_emulator.roots import TIME_TOLERANCE_S
from positioner.values import dataclass

if TYPE_CHECKING:
    from plant_emulator.parameters import PlantSettings

FORCE_MARGIN_N = 1e-7
"""A stem at rest slips this much above F_s; else a force rounded to F_s would make it slip and stop without end."""

_FLAT = 5.0
"""Times V_s: from this speed on the Stribeck term is below 1.4e-11 of F_s - F_c, and the closed form holds."""
_FLAT_AGAIN = 6.0
"""Times V_s: above this speed slow sliding ends. It is higher than `_FLAT`, where slow sliding begins."""


def located_n(slope_n_per_s: float) -> float:
    """Return the allowed distance in N between a limit and a force that is located there, with the sign of the slope.

    `slope_n_per_s` is the rate of change of the force. The distance is twice the change within the time tolerance of
    `roots`, so that a motion that begins beyond it lasts longer than this tolerance.
    """
    return 2.0 * TIME_TOLERANCE_S * slope_n_per_s


@dataclass(frozen=True, slots=True, eq=False)
class Constants:
    """Values that follow from the settings alone."""

    settings: PlantSettings
    sliding: Oscillator
    """Mass and spring with F_v."""
    breaking: Oscillator
    """Mass and spring inside the zero-speed band, where eq. 3 has no F_v."""
    spring_n_per_m: float
    """Of the spring and the process together."""
    preload_n: float
    """Force against opening at position 0: bench set and process."""
    band_m_per_s: float
    """DV, or 0 without dry friction: a valve that cannot stick has no band."""
    flat_m_per_s: float
    """Sliding faster than this has a closed form."""
    flat_again_m_per_s: float
    sticks: bool
    varies_by_place: bool
    ages: bool
    """Whether static friction grows at rest."""


class _Latest:
    """The constants that were wanted last; the hash of all settings takes as long as a step of a stem at rest."""

    constants: ClassVar[Constants | None] = None


def constants_of(settings: PlantSettings) -> Constants:
    """Return the constants of the valve in `settings`."""
    latest = _Latest.constants
    if latest is None or latest.settings is not settings:
        latest = _Latest.constants = _computed(settings)
    return latest


def _computed(settings: PlantSettings) -> Constants:
    valve, process = settings.valve, settings.process
    spring_n_per_m = valve.spring_rate_n_per_m + process.gradient_n_per_m
    sticks = valve.static_friction_n > 0.0
    band = valve.stick_velocity_m_per_s if sticks else 0.0
    oscillator = partial(Oscillator, mass_kg=valve.mass_kg, spring_n_per_m=spring_n_per_m)
    curved = valve.static_friction_n > valve.coulomb_friction_n
    return Constants(
        settings=settings,
        sliding=oscillator(damping_n_s_per_m=valve.viscous_friction_n_s_per_m),
        breaking=oscillator(damping_n_s_per_m=0.0),
        spring_n_per_m=spring_n_per_m,
        preload_n=valve.bench_set_n + process.force_n,
        band_m_per_s=band,
        flat_m_per_s=max(band, _FLAT * valve.stribeck_velocity_m_per_s) if curved else band,
        flat_again_m_per_s=max(band, _FLAT_AGAIN * valve.stribeck_velocity_m_per_s),
        sticks=sticks,
        ages=settings.packing.growth_per_decade > 0.0 or settings.packing.creep_fraction > 0.0,
        varies_by_place=settings.stochastic.friction_fraction > 0.0 or settings.packing.varies_by_place,
    )
