"""The options that choose a plant: a preset or a file, and changes of single parameters. Shell."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from plant_emulator.plants import complete_tables, plant_in_file, plant_named, plant_names
from plant_emulator.presets import DEFAULT_PRESET, overridden, preset_names
from positioner.inputs.numbers import number
from positioner.inputs.toml_reader import changes_of
from positioner.machine.completion import suggest

if TYPE_CHECKING:
    import argparse

    from plant_emulator.parameters import PlantSettings

SECONDS = number(1e-6, 1e6, "seconds from 1e-6 to 1e6")
"""The type of an option that is a time in s."""


def add_plant_options(parser: argparse.ArgumentParser) -> None:
    """Add the options to `parser`; `plant_of` reads them."""
    plant = parser.add_mutually_exclusive_group()
    plant.add_argument(
        "--preset",
        choices=preset_names(),
        metavar="NAME",
        help=f"plant to emulate (default: {DEFAULT_PRESET}; see `plant-emulator presets`)",
    )
    plant.add_argument("--config", type=Path, metavar="PLANT.toml", help="plant file, which may be based on a preset")
    other = plant.add_argument(
        "--plant", metavar="FILE.py:NAME", help="a plant of others: FILE.py:NAME, an installed one, a preset or a file"
    )
    suggest(other, plant_names, "*.toml", "*.py")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        dest="changes",
        metavar="KEY=VALUE",
        help="change one parameter, such as valve.mass_kg=2 (repeatable)",
    )


def plant_of(options: argparse.Namespace) -> PlantSettings:
    """Return the plant that the options of `add_plant_options` describe.

    Raises:
        ConfigurationError: a file, a key or a value is wrong.
    """
    changes = changes_of(options.changes, "valve.mass_kg=2")
    if options.config is not None:
        return plant_in_file(options.config, changes)
    if options.plant is None:
        return overridden({"preset": options.preset or DEFAULT_PRESET}, changes, "--set")
    settings = plant_named(options.plant)
    return overridden(complete_tables(settings), changes, "--set") if changes else settings
