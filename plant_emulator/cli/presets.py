"""`plant-emulator presets`: the plants that come with the emulator. Shell."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from plant_emulator.presets import preset_names, preset_summary
from positioner.errors import ExitCode

if TYPE_CHECKING:
    import argparse


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    parser = subparsers.add_parser(
        "presets",
        help="list the valves that come with the emulator",
        description="List the valves that come with the emulator, one per line.",
        epilog="example: plant-emulator presets",
    )
    parser.set_defaults(run=_run)


def _run(_arguments: argparse.Namespace) -> ExitCode:
    names = preset_names()
    width = max(map(len, names))
    sys.stdout.writelines(f"{name:{width}}  {preset_summary(name)}\n" for name in names)
    return ExitCode.OK
