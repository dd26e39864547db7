"""`positioner tune`: the best parameters of a law for the nominal valve. Shell."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from positioner.errors import ExitCode, UsageError, writing
from positioner.studies.tuning import LEAGUE_SEEDS, SEARCHES, to_toml, tune

_EPILOG = """\
examples:
  positioner tune pi                              a few minutes; the result goes to standard output
  positioner tune knocker --budget 400 --seed 2 --out knocker.toml

The result is a configuration: put your own [valve] and [bus] in, or its [control.<law>] table into yours. A comment
says how it was found. The packaged parameters, which every law has by default, were found in the same way.
"""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    parser = subparsers.add_parser(
        "tune",
        help="find the parameters of a law",
        description="Find the parameters of a law by seeded random search on the nominal valve.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("law", choices=tuple(SEARCHES), metavar="LAW", help=", ".join(SEARCHES))
    parser.add_argument("--budget", type=int, default=100, metavar="N", help="candidates that are tried (%(default)s)")
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="of the search and the noise (%(default)s)")
    parser.add_argument("--out", type=Path, metavar="FILE", help="file for the result instead of standard output")
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> ExitCode:
    if arguments.budget < 1:
        raise UsageError("--budget must be at least 1")
    if arguments.seed < 0 or arguments.seed in LEAGUE_SEEDS:
        told = f"{LEAGUE_SEEDS.start} to {LEAGUE_SEEDS.stop - 1}"
        raise UsageError(f"--seed must not be negative, nor {told}: on those seeds the laws are judged")
    found = tune(arguments.law, arguments.budget, arguments.seed)
    sys.stderr.write(f"{found.law}: cost {found.first_cost:.3f} of the first candidate, {found.cost:.3f} of the best\n")
    if arguments.out is None:
        sys.stdout.write(to_toml(found))
        return ExitCode.OK
    with writing(arguments.out):
        arguments.out.write_text(to_toml(found), encoding="utf-8")
    return ExitCode.OK
