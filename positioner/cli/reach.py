"""`positioner reach`: what a valve can reach, computed from its configuration, and what would improve it. Shell."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.cli.command import add_command, add_config, add_valve
from positioner.cli.tables import add_output, show, show_json
from positioner.config.reader import load_config
from positioner.doctor import bus_load
from positioner.errors import ExitCode
from positioner.reach.case import Case
from positioner.reach.figures import figures_of
from positioner.reach.improvements import improvements
from positioner.reach.report import as_values, blocks

if TYPE_CHECKING:
    import argparse

    from positioner.cli.command import Commands

_EPILOG = """\
examples:
  positioner reach --config fv101.toml             the figures, with what would improve them
  positioner reach --config fv101.toml --json      the same for programs, in SI units

It computes with the law's own model and moves nothing: the better the parameters are known, the truer the figures.

exit status: 0 done, 78 the configuration is wrong.
"""


def add_parser(commands: Commands) -> None:
    """Add `positioner reach`."""
    parser = add_command(commands, "reach", _run, "compute what a valve can reach, and what would improve it", _EPILOG)
    add_config(parser)
    add_valve(parser)
    add_output(parser)


def _run(arguments: argparse.Namespace) -> ExitCode:
    configuration = load_config(arguments.config, valve=arguments.valve)
    case = Case.of(configuration)
    figures = figures_of(case)
    changes = improvements(case, figures)
    codec = configuration.make_codec()
    if arguments.json:
        load = bus_load.bus_load(codec, case.period_s, bus_load.FASTEST).total
        show_json({**as_values(case, figures, changes), "bus_load_at_1_mbit_per_s": load})
    else:
        found = blocks(case, figures, changes, bus_load.in_words(codec, case.period_s))
        show(found, as_markdown=arguments.markdown)
    return ExitCode.OK
