"""The reference of plant files, from the emulator's dataclasses. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from documents.configuration import section
from documents.keys import tables_of
from plant_emulator.parameters import PlantSettings
from plant_emulator.presets import plant_settings

if TYPE_CHECKING:
    from documents.keys import Table

_INTRODUCTION = """\
# Plant files

Every key of the file of an emulated valve, for `plant-emulator run --config FILE` and `positioner bench --plant FILE`.
Units are SI; the end of a key names its unit. What is left out is as in `preset`. The column *default* is that of the
preset `paper`; without a preset, `[valve]` must have its parameters. `--set KEY=VALUE` changes one key on the command
line. `examples/plant.toml` shows a file.
"""


def tables() -> list[Table]:
    """Return every table of a plant file."""
    return tables_of(PlantSettings, plant_settings("paper"))


def page() -> str:
    """Return the reference in Markdown."""
    return _INTRODUCTION + "".join(section(table) for table in tables())
