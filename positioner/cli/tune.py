"""`positioner tune`: the best parameters of a law for the nominal valve. Shell."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from positioner.cli.command import add_command, add_workers, workers_of
from positioner.errors import ExitCode, UsageError, writing
from positioner.studies.pool import opened
from positioner.studies.tuning import LEAGUE_SEEDS, SEARCHES, to_toml, tune

if TYPE_CHECKING:
    import argparse

    from positioner.cli.command import Commands

_EPILOG = """\
examples:
  positioner tune pi                              a few minutes; the result goes to standard output
  positioner tune knocker --budget 400 --seed 2 --out knocker.toml

The number of workers changes only how long it takes.

The result is a configuration: replace its [valve] by yours and add your [bus], or copy its [control.<law>] table into
your configuration. A comment gives the command that found it. The packaged parameters of these laws were found in the
same way.
"""


def add_parser(commands: Commands) -> None:
    """Add `positioner tune`."""
    parser = add_command(
        commands, "tune", _run, "find the parameters of a law by random search on the nominal valve", _EPILOG
    )
    parser.add_argument("law", choices=tuple(SEARCHES), metavar="LAW", help=", ".join(SEARCHES))
    parser.add_argument("--budget", type=int, default=100, metavar="N", help="candidates to try (default: %(default)s)")
    parser.add_argument(
        "--seed", type=int, default=1, metavar="N", help="seed of the search and of the noise (default: %(default)s)"
    )
    add_workers(parser)
    parser.add_argument("--out", type=Path, metavar="FILE", help="file for the result instead of standard output")


def _run(arguments: argparse.Namespace) -> ExitCode:
    if arguments.budget < 1:
        raise UsageError("--budget must be at least 1")
    if arguments.seed < 0 or arguments.seed in LEAGUE_SEEDS:
        reserved = f"{LEAGUE_SEEDS.start} to {LEAGUE_SEEDS.stop - 1}"
        raise UsageError(f"--seed must not be negative, nor {reserved}: the league compares the laws on those seeds")
    with opened(workers_of(arguments)) as pool:
        found = tune(arguments.law, arguments.budget, arguments.seed, pool)
    sys.stderr.write(f"{found.law}: cost {found.first_cost:.3f} of the first candidate, {found.cost:.3f} of the best\n")
    if arguments.out is None:
        sys.stdout.write(to_toml(found))
        return ExitCode.OK
    with writing(arguments.out):
        arguments.out.write_text(to_toml(found), encoding="utf-8")
    return ExitCode.OK
