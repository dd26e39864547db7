"""The plants of the league, named as the emulator's presets, and the check of the setpoints. Pure.

On every plant the laws have the parameters of the nominal one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from plant_emulator.presets import plant_settings, preset_names
from positioner.bench.playable import setpoint_problems
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
ALL_PLANTS = preset_names()
"""The plants of the league and all others: other valves, and valves on which laws cannot be compared."""


def reference_plant(plants: Sequence[str]) -> str:
    """Return the plant on which settling times are compared: the nominal one, else the first one played."""
    return NOMINAL if NOMINAL in plants else plants[0]


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
