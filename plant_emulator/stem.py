"""The stem at one instant, and the forces on it (paper eqs 3 and 4). Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from plant_emulator.friction import stribeck_n
from positioner.values import dataclass

if TYPE_CHECKING:
    from plant_emulator.constants import Constants
    from plant_emulator.friction import Packing
    from plant_emulator.parameters import ValveSettings


@dataclass(frozen=True, slots=True, kw_only=True)
class Stem:
    """Position, velocity and counters; the counters and the travel run from the start of the plant."""

    position_m: float
    velocity_m_per_s: float = 0.0
    direction: int = 0
    """+1 opening, -1 closing, 0 at rest."""
    last_direction: int = 0
    """Direction of the last motion, 0 before the first one."""
    slips: int = 0
    stops: int = 0
    reversals: int = 0
    travel_m: float = 0.0

    @property
    def is_at_rest(self) -> bool:
        """Whether static friction or a travel stop holds the stem, or a frictionless stem is in balance."""
        return self.direction == 0


def pull_n(constants: Constants, stem: Stem, packing: Packing, push_n: float) -> float:
    """Return F_e of eq. 3 in N: the force `push_n` of the actuator less those of spring, process and packing."""
    return push_n - (constants.preload_n + packing.one_way_n) - constants.spring_n_per_m * stem.position_m


def sliding_n(valve: ValveSettings, packing: Packing, speed_m_per_s: float) -> float:
    """Return the size of the friction of eq. 4 in N."""
    dry_n = stribeck_n(speed_m_per_s, packing.static_n, packing.coulomb_n, valve.stribeck_velocity_m_per_s)
    return dry_n + valve.viscous_friction_n_s_per_m * speed_m_per_s


def friction_n(constants: Constants, stem: Stem, packing: Packing, push_n: float) -> float:
    """Return the friction on the stem in N, positive against opening motion; at rest it is the pull, at most F_s."""
    valve, band = constants.settings.valve, constants.band_m_per_s
    pull, speed = pull_n(constants, stem, packing, push_n), abs(stem.velocity_m_per_s)
    static_n = packing.static_n
    if stem.direction == 0:
        return min(max(pull, -static_n), static_n)
    if speed < band:
        return math.copysign(static_n, pull)
    resisting_n = sliding_n(valve, packing, speed)
    if speed == band and static_n < stem.direction * pull <= resisting_n:
        return pull
    return stem.direction * resisting_n
