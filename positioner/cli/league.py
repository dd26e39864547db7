"""`positioner league`: all laws on all plants. Shell."""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from positioner.errors import ExitCode, UsageError
from positioner.inputs.nearest import names_in
from positioner.laws.registry import LAWS

if TYPE_CHECKING:
    from positioner.studies.league import LeagueSettings

_EPILOG = """\
examples:
  positioner league                                     every law, every plant, seeds 101 to 103, 1 kHz
  positioner league --short                             a minute's worth of it
  positioner league --laws nmpc,paper --period 0.0001   at 10 kHz: about an hour of two cores

An interrupted league goes on where it stopped. It leaves league.json, league.md and league.png in the output directory.
"""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    parser = subparsers.add_parser(
        "league",
        help="compare all laws on all plants",
        description="Compare control laws on the nominal valve and on valves that differ from what the laws believe.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--laws", metavar="A,B,…", help=f"laws (all: {', '.join(LAWS)})")
    parser.add_argument("--plants", metavar="A,B,…", help="presets of the emulator (all variants of the nominal valve)")
    parser.add_argument("--seeds", metavar="N,M,…", help="seeds (101,102,103)")
    parser.add_argument("--setpoints", metavar="MM,MM,…", help="setpoints in mm instead of the usual eight")
    parser.add_argument("--dwell", type=float, metavar="S", help="length of a dwell (5 s)")
    parser.add_argument("--period", type=float, metavar="S", help="sample period (0.001 s)")
    short = "unless told otherwise: three laws, two plants, one seed, four dwells of 1 s"
    parser.add_argument("--short", action="store_true", help=short)
    parser.add_argument("--workers", type=int, metavar="N", help="processes (one a core)")
    parser.add_argument(
        "--out", type=Path, default=Path("league"), metavar="DIR", help="output directory (%(default)s)"
    )
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> ExitCode:
    # matplotlib and the plant are needed here only
    from positioner.studies.conditions import reference_plant  # noqa: PLC0415
    from positioner.studies.league import play_league  # noqa: PLC0415
    from positioner.studies.league_report import LeagueReport, to_markdown, write_report  # noqa: PLC0415
    from positioner.studies.standings import optimal_median_s, standings, summaries  # noqa: PLC0415

    settings = _settings(arguments)
    played = play_league(settings, arguments.out / "bouts", arguments.workers)
    table = standings(played)
    settle_s, rest_s = optimal_median_s(reference_plant(settings.plants), settings.setpoints_mm)
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
    """Return what is to be played: the whole league or its short form, with what was asked for in the place of its own.

    Raises:
        UsageError: a name is unknown, or a number is none.
    """
    from positioner.studies.conditions import ALL_PLANTS, NOMINAL, PLANTS  # noqa: PLC0415
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
    told: dict[str, Any] = {"dwell_s": arguments.dwell, "period_s": arguments.period}
    if arguments.laws:
        told["laws"] = names_in("law", arguments.laws, tuple(LAWS))
    if arguments.plants:
        told["plants"] = names_in("plant", arguments.plants, ALL_PLANTS)
    if arguments.seeds is not None:
        told["seeds"] = tuple(dict.fromkeys(_whole("seed", seed) for seed in arguments.seeds.split(",")))
    if arguments.setpoints:
        told["setpoints_mm"] = tuple(_number("setpoint", value) for value in arguments.setpoints.split(","))
    return replace(settings, **{name: value for name, value in told.items() if value is not None})


def _whole(what: str, text: str) -> int:
    if not text.strip().isdecimal():
        raise UsageError(f"{what} '{text}' is no whole number")
    return int(text)


def _number(what: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise UsageError(f"{what} '{text}' is no number") from None
