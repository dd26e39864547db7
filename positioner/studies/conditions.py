"""The plants of the league by name, and the check of the setpoints. Shell: a plant may be a file.

On a preset the laws have the parameters of the nominal valve of which it is a variant, on a plant of one's own those of
that plant.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from plant_emulator.plants import plant_named, plant_names, plant_problem
from positioner.bench.playable import setpoint_problems, within_reach
from positioner.bench.setpoints import PLACES
from positioner.errors import ConfigurationError, UsageError

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


def known_plants() -> tuple[str, ...]:
    """Return the names of all plants that need no file, the same for every command."""
    return plant_names()


def plant_mistake(name: str) -> str | None:
    """Return what is wrong with the name of a plant, None where it is one."""
    return plant_problem(name)


def plants_in(given: str) -> tuple[str, ...]:
    """Return the names of plants in a list with commas, each once: presets, installed ones and files.

    Raises:
        UsageError: one is no plant.
    """
    names = tuple(dict.fromkeys(name.strip() for name in given.split(",")))
    for name in names:
        if problem := plant_problem(name):
            raise UsageError(f"plant {name!r} {problem}")
    return names


def reference_plant(plants: Sequence[str]) -> str:
    """Return the plant on which settling times are compared: the nominal one, else the first one played."""
    return NOMINAL if NOMINAL in plants else plants[0]


def setpoints_in_reach(plant: str) -> tuple[float, ...]:
    """Return eight setpoints in mm over the whole range from which this plant can be restarted both ways.

    Much of it may lie where the nominal valve, which the laws believe in, could not be restarted.
    """
    return within_reach(plant_named(plant), PLACES)


def check_setpoints(setpoints_mm: tuple[float, ...], plants: tuple[str, ...]) -> None:
    """Refuse setpoints from which some plant cannot be restarted: no law can serve them.

    Raises:
        ConfigurationError: a setpoint is refused; the message has a line for each, with the name of the plant.
    """
    problems = [problem for plant in plants for problem in setpoint_problems(setpoints_mm, plant, plant_named(plant))]
    if problems:
        raise ConfigurationError("league", tuple(problems))
