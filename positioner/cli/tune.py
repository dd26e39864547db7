"""`positioner tune`: the best parameters of a law for the nominal valve. Shell."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from positioner.cli.command import add_command, add_workers, workers_of
from positioner.errors import ExitCode, UsageError, writing
from positioner.inputs.nearest import check_name
from positioner.studies.pool import opened
from positioner.studies.tuning import LEAGUE_SEEDS, SEARCHES, to_toml, tune

if TYPE_CHECKING:
    import argparse

    from positioner.cli.command import Commands

_EPILOG = """\
examples:
  positioner tune pi                              a few minutes; the result goes to standard output
  positioner tune knocker --budget 400 --seed 2 --out knocker.toml
  positioner tune pi --real-valves                by differential evolution, at lags of 0 to 300 ms

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
    parser.add_argument(
        "--real-valves", action="store_true", help="for each lag and noise of `positioner league --real-valves`"
    )
    add_workers(parser)
    parser.add_argument("--out", type=Path, metavar="FILE", help="file for the result instead of standard output")


def _run(arguments: argparse.Namespace) -> ExitCode:
    if arguments.budget < 1:
        raise UsageError("--budget must be at least 1")
    if arguments.seed < 0 or arguments.seed in LEAGUE_SEEDS:
        reserved = f"{LEAGUE_SEEDS.start} to {LEAGUE_SEEDS.stop - 1}"
        raise UsageError(f"--seed must not be negative, nor {reserved}: the league compares the laws on those seeds")
    if arguments.real_valves:
        return _write(arguments.out, _tuned_for_real_valves(arguments))
    with opened(workers_of(arguments)) as pool:
        found = tune(arguments.law, arguments.budget, arguments.seed, pool)
    sys.stderr.write(f"{found.law}: cost {found.first_cost:.3f} of the first candidate, {found.cost:.3f} of the best\n")
    return _write(arguments.out, to_toml(found))


def _tuned_for_real_valves(arguments: argparse.Namespace) -> str:
    """Return the file of the law's parameters at every lag.

    Raises:
        UsageError: this law is not tuned there, or by a seed on which laws are compared.
    """
    from positioner.studies.real_valves import tuning  # noqa: PLC0415 - scipy's optimizer
    from positioner.studies.real_valves.bouts import SEEDS  # noqa: PLC0415 - the plant
    from positioner.studies.real_valves.valves import LAGS_S, NOISES  # noqa: PLC0415

    check_name("law", arguments.law, tuple(tuning.RANGES), "its parameters follow from the lag")
    if arguments.seed in SEEDS:
        raise UsageError(f"--seed must not be one of {', '.join(map(str, SEEDS))}: the league compares laws on those")
    law, budget, seed = arguments.law, arguments.budget, arguments.seed
    tasks = [tuning.Task(law, lag_s, noise, budget, seed) for noise in NOISES for lag_s in LAGS_S]
    with opened(workers_of(arguments)) as pool:
        return tuning.to_toml(law, budget, seed, tuning.tune_all(tasks, pool))


def _write(out: Path | None, text: str) -> ExitCode:
    if out is None:
        sys.stdout.write(text)
        return ExitCode.OK
    with writing(out):
        out.write_text(text, encoding="utf-8")
    return ExitCode.OK
