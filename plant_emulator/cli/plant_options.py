"""The options that choose a plant: a preset or a file, and changes of single parameters. Shell."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from plant_emulator.presets import DEFAULT_PRESET, overridden, preset_names
from positioner.inputs.numbers import number
from positioner.inputs.toml_reader import changes_of, read_text, tables

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
    if options.config is None:
        return overridden({"preset": options.preset or DEFAULT_PRESET}, changes, "--set")
    text = read_text(options.config)
    source = f"{options.config} with --set" if changes else str(options.config)
    return overridden(tables(text, str(options.config)), changes, source, text)
