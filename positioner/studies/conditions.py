"""The plants that laws are judged on, named as the emulator's presets, and where on them a setpoint is fair. Pure.

The laws believe in the nominal one throughout.
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
"""Also those that are no variants of the nominal one, or none that a law could be judged on."""


def reference_plant(plants: Sequence[str]) -> str:
    """Return the plant on which speeds are compared: the nominal one, or the first where that one is not played."""
    return NOMINAL if NOMINAL in plants else plants[0]


def check_setpoints(setpoints_mm: tuple[float, ...], plants: tuple[str, ...]) -> None:
    """Refuse setpoints from which some plant cannot be restarted: a law would be judged on what no law can do.

    Raises:
        ConfigurationError: with a line for each setpoint and the plant that rules it out.
    """
    problems = [
        problem for plant in plants for problem in setpoint_problems(setpoints_mm, plant, plant_settings(plant))
    ]
    if problems:
        raise ConfigurationError("league", tuple(problems))
