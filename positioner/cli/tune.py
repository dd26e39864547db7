"""`positioner tune`: the best parameters of a law for the nominal valve. Shell."""

from __future__ import annotations

import sys
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING

from positioner.cli.command import add_command, add_workers, refuse_without_folder, workers_of
from positioner.cli.names import add_plant, plant_of
from positioner.cli.tables import add_json, note, show_json
from positioner.errors import ExitCode, UsageError, writing
from positioner.inputs.nearest import check_name
from positioner.laws.registry import LAWS, law_problem
from positioner.machine.completion import suggest
from positioner.studies.pool import opened
from positioner.studies.searches import SEARCHES
from positioner.studies.tuning import LEAGUE_SEEDS, to_toml, tune

if TYPE_CHECKING:
    import argparse

    from positioner.cli.command import Commands

_EPILOG = """\
examples:
  positioner tune pi                              a few minutes; the result goes to standard output
  positioner tune knocker --budget 400 --seed 2 --out knocker.toml
  positioner tune examples/my_law.py:MyLaw --plant friction+20
  positioner tune pi --real-valves                by differential evolution, at lags of 0 to 300 ms

The number of workers changes only how long it takes.

The result is a configuration: replace its [valve] by yours and add your [bus], or copy its [control.<law>] table into
your configuration. A comment gives the command that found it. The packaged parameters of these laws were found in the
same way.

exit status: 0 done, 1 failed, 2 wrong command line, 74 the file cannot be written, 78 a law or plant of yours is wrong.
"""


def add_parser(commands: Commands) -> None:
    """Add `positioner tune`."""
    parser = add_command(
        commands, "tune", _run, "find the parameters of a law by random search on the nominal valve", _EPILOG
    )
    law = parser.add_argument(
        "law", metavar="LAW", help=f"{', '.join(SEARCHES)}, or FILE.py:NAME, a class with `tuned`"
    )
    suggest(law, lambda: tuple(SEARCHES), "*.py")
    add_plant(parser, "plant to tune it on instead of the nominal valve")
    parser.add_argument("--budget", type=int, default=100, metavar="N", help="candidates to try (default: %(default)s)")
    parser.add_argument(
        "--seed", type=int, default=1, metavar="N", help="seed of the search and of the noise (default: %(default)s)"
    )
    parser.add_argument(
        "--real-valves", action="store_true", help="for each lag and noise of `positioner league --real-valves`"
    )
    add_workers(parser)
    add_json(parser)
    parser.add_argument("--out", type=Path, metavar="FILE", help="file for the result instead of standard output")


def _run(arguments: argparse.Namespace) -> ExitCode:
    if arguments.budget < 1:
        raise UsageError("--budget must be at least 1")
    if arguments.seed < 0 or arguments.seed in LEAGUE_SEEDS:
        reserved = f"{LEAGUE_SEEDS.start} to {LEAGUE_SEEDS.stop - 1}"
        raise UsageError(f"--seed must not be negative, nor {reserved}: the league compares the laws on those seeds")
    if arguments.law not in LAWS and (problem := law_problem(arguments.law, tuple(SEARCHES))):
        raise UsageError(f"law {arguments.law!r} {problem}")
    refuse_without_folder("--out", arguments.out)  # a search takes minutes to hours
    if arguments.real_valves:
        if arguments.plant:
            raise UsageError("--plant does not go with --real-valves: it has a plant for each lag")
        return _write(arguments, _tuned_for_real_valves(arguments), {})
    with opened(workers_of(arguments)) as pool:
        found = tune(arguments.law, arguments.budget, arguments.seed, pool, plant_of(arguments) or "paper")
    note(f"{found.law}: cost {found.first_cost:.3f} of the first candidate, {found.cost:.3f} of the best")
    return _write(arguments, to_toml(found), {"first_cost": found.first_cost, "cost": found.cost})


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


def _write(arguments: argparse.Namespace, text: str, costs: dict[str, float]) -> ExitCode:
    """Write the configuration to its file, or print it: as JSON with what it costs, or as it is."""
    if arguments.out is not None:
        with writing(arguments.out):
            arguments.out.write_text(text, encoding="utf-8")
    if arguments.json:
        search = {"law": arguments.law, "budget": arguments.budget, "seed": arguments.seed}
        show_json({**search, **costs, "configuration": tomllib.loads(text)})
    elif arguments.out is None:
        sys.stdout.write(text)
    return ExitCode.OK
