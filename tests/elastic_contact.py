"""Plants with an elastic contact, played in their tests; and the contact dragged along by hand."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from plant_emulator import valve
from plant_emulator.constants import constants_of
from plant_emulator.presets import plant_settings

if TYPE_CHECKING:
    from collections.abc import Iterable
    from typing import Any

    from numpy.typing import NDArray

    from plant_emulator.contact import ContactStem
    from plant_emulator.parameters import PlantSettings

MOVES = ((4.0, 0.02), (8.0, 0.15), (7.5, 0.05), (12.0, 0.15), (9.0, 0.05), (3.0, 0.1))
"""Currents in mA with their durations in s: a presliding push, moves, and reversals of both."""


def quiet(preset: str, lag_s: float, **tables: Any) -> PlantSettings:
    """Return the preset with a lag and without noise, with `tables` laid over it."""
    lags = {"fill_time_constant_s": lag_s, "vent_time_constant_s": lag_s}
    return plant_settings(preset, {"actuator": lags, "sensor": {"noise_of_reading": 0.0}, **tables})


def played(settings: PlantSettings, period_s: float) -> NDArray[np.float64]:
    """Return the positions in m after each period of `MOVES`, shape (periods,)."""
    state, found = valve.initial_state(settings, 1), []
    for current_ma, seconds in MOVES:
        for _ in range(round(seconds / period_s)):
            state = valve.step(settings, state, current_ma, period_s)
            found.append(state.stem.position_m)
    return np.array(found)


def dragged(settings: PlantSettings, velocities: Iterable[float], step_s: float) -> NDArray[np.float64]:
    """Return the friction in N after each step of an imposed velocity in m/s, shape (velocities,)."""
    state = valve.initial_state(settings, 1)
    moving: ContactStem = valve.moved(settings, state)  # type: ignore[assignment]
    found = []
    for velocity in map(float, velocities):
        moving.resist(velocity, step_s, 0.5)
        mean = moving.base_n + moving.slope * velocity
        moving.slide(velocity)
        found.append(mean + constants_of(settings).settings.valve.viscous_friction_n_s_per_m * velocity)
    return np.array(found)
