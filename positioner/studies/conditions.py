"""The plants of the league, named as the emulator's presets, and the check of the setpoints. Pure.

On every plant the laws have the parameters of the nominal one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from plant_emulator.presets import plant_settings, preset_names
from positioner.bench.playable import setpoint_problems, within_reach
from positioner.errors import ConfigurationError

if TYPE_CHECKING:
    from collections.abc import Sequence

NOMINAL = "paper"
PLANTS = (
    NOMINAL,
    "spring-10",
    "spring-20",
    "friction-10",
    "friction-20",
    "friction+10",
    "friction+20",
    "stochastic",
    "noise-free",
)
_PLACES = (0.41, 0.95, 0.05, 0.6, 0.3, 0.9, 0.1, 0.75)
"""Setpoints over the whole range from which a plant can be restarted, as parts of it."""
ALL_PLANTS = preset_names()
"""The plants of the league and all others: other valves, and valves on which laws cannot be compared."""


def reference_plant(plants: Sequence[str]) -> str:
    """Return the plant on which settling times are compared: the nominal one, else the first one played."""
    return NOMINAL if NOMINAL in plants else plants[0]


def setpoints_in_reach(plant: str) -> tuple[float, ...]:
    """Return eight setpoints in mm over the whole range from which this plant can be restarted both ways.

    Much of it may lie where the nominal valve, which the laws believe in, could not be restarted.
    """
    return within_reach(plant_settings(plant), _PLACES)


def check_setpoints(setpoints_mm: tuple[float, ...], plants: tuple[str, ...]) -> None:
    """Refuse setpoints from which some plant cannot be restarted: no law can serve them.

    Raises:
        ConfigurationError: a setpoint is refused; the message has a line for each, with the name of the plant.
    """
    problems = [
        problem for plant in plants for problem in setpoint_problems(setpoints_mm, plant, plant_settings(plant))
    ]
    if problems:
        raise ConfigurationError("league", tuple(problems))
