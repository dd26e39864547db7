"""`positioner league`: all laws on all plants. Shell."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from positioner.cli.command import add_command, add_study, numbers_in, workers_of
from positioner.cli.real_league import add_real_valves, refuse_without
from positioner.cli.real_league import play as play_on_real_valves
from positioner.errors import ExitCode
from positioner.inputs.nearest import names_in
from positioner.laws.registry import LAWS

if TYPE_CHECKING:
    import argparse

    from positioner.cli.command import Commands
    from positioner.studies.league import LeagueSettings

_EPILOG = """\
examples:
  positioner league                                     every law, every plant, seeds 101 to 103, 1 kHz
  positioner league --short                             a part of it that takes about a minute
  positioner league --laws nmpc,paper --period 0.0001   at 10 kHz: about an hour on two cores
  positioner league --laws nmpc --setpoints reach       setpoints where the real valve can go, not the believed one
  positioner league --laws nmpc,nmpc-without-table --restart --plants stochastic
  positioner league --real-valves                       valves with lags of 0 to 300 ms, and each goal: met or not
  positioner league --real-valves --short --tau 5,50    a quick look at two lags
  positioner league --real-valves --laws nmpc --plants paper --conditions told-dead-time-10

`nmpc-without-table` is nmpc that never uses its stiction table. An interrupted league continues where it stopped. The
output directory then holds league.json, league.md and league.png, or real-valves.json and so on.
"""


_IN_REACH = "reach"


def add_parser(commands: Commands) -> None:
    """Add `positioner league`."""
    parser = add_command(commands, "league", _run, "compare all laws on all plants", _EPILOG)
    parser.add_argument("--laws", metavar="A,B,…", help=f"laws (default: {', '.join(LAWS)})")
    parser.add_argument(
        "--plants", metavar="A,B,…", help="presets of the emulator (default: all variants of the nominal valve)"
    )
    parser.add_argument("--seeds", metavar="N,M,…", help="seeds (default: 101,102,103)")
    parser.add_argument(
        "--setpoints",
        metavar="MM,MM,…",
        help=f"setpoints in mm instead of the default eight; {_IN_REACH}: eight over the whole range of each plant",
    )
    parser.add_argument(
        "--restart", action="store_true", help="judge each law after a restart, with the table it learned"
    )
    parser.add_argument("--dwell", type=float, metavar="S", help="length of a dwell (default: 5 s)")
    parser.add_argument("--period", type=float, metavar="S", help="sample period (default: 0.001 s)")
    short = "other defaults: three laws, two plants, one seed, four dwells of 1 s"
    parser.add_argument("--short", action="store_true", help=short)
    add_real_valves(parser)
    add_study(parser, Path("league"))


def _run(arguments: argparse.Namespace) -> ExitCode:
    if arguments.real_valves:
        return play_on_real_valves(arguments)
    refuse_without(arguments)
    # matplotlib and the plant are needed here only
    from positioner.studies.conditions import reference_plant  # noqa: PLC0415
    from positioner.studies.league import play_league  # noqa: PLC0415
    from positioner.studies.league_report import LeagueReport, to_markdown, write_report  # noqa: PLC0415
    from positioner.studies.standings import optimal_median_s, standings, summaries  # noqa: PLC0415

    settings = _settings(arguments)
    played = play_league(settings, arguments.out / "bouts", workers_of(arguments))
    table = standings(played)
    reference = reference_plant(settings.plants)
    settle_s, rest_s = optimal_median_s(reference, settings.setpoints_of(reference))
    report = LeagueReport(
        settings=settings,
        summaries=summaries(table, settle_s),
        standings=table,
        optimal_settle_1pct_s=settle_s,
        optimal_rest_s=rest_s,
    )
    write_report(arguments.out, report)
    sys.stdout.write(to_markdown(report))
    sys.stdout.write(f"\n{arguments.out}: league.json, league.md, league.png\n")
    return ExitCode.OK


def _settings(arguments: argparse.Namespace) -> LeagueSettings:
    """Return the settings of the whole league or of its short form, with the arguments in place of the defaults.

    Raises:
        UsageError: a name is unknown, or a number cannot be read.
    """
    from positioner.studies.conditions import ALL_PLANTS, NOMINAL, PLANTS  # noqa: PLC0415
    from positioner.studies.entrants import ENTRANTS  # noqa: PLC0415
    from positioner.studies.league import SETPOINTS_MM, LeagueSettings  # noqa: PLC0415

    settings = LeagueSettings(laws=tuple(LAWS), plants=PLANTS, seeds=(101, 102, 103))
    if arguments.short:
        settings = LeagueSettings(
            laws=("nmpc", "paper", "pi"),
            plants=(NOMINAL, "friction+20"),
            seeds=(101,),
            setpoints_mm=SETPOINTS_MM[:4],
            dwell_s=1.0,
        )
    given: dict[str, Any] = {
        "dwell_s": arguments.dwell,
        "period_s": arguments.period,
        "restarted": arguments.restart or None,
    }
    if arguments.laws:
        given["laws"] = names_in("law", arguments.laws, ENTRANTS)
    if arguments.plants:
        given["plants"] = names_in("plant", arguments.plants, ALL_PLANTS)
    if arguments.seeds is not None:
        given["seeds"] = tuple(dict.fromkeys(int(seed) for seed in numbers_in("seed", arguments.seeds, whole=True)))
    if arguments.setpoints == _IN_REACH:
        settings = replace(settings, setpoints_mm=None)
    elif arguments.setpoints:
        given["setpoints_mm"] = numbers_in("setpoint", arguments.setpoints)
    return replace(settings, **{name: value for name, value in given.items() if value is not None})
