"""`positioner league`: all laws on all plants. Shell."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from positioner.cli.command import add_command, add_study, numbers_in, workers_of
from positioner.cli.names import add_signals
from positioner.cli.real_league import add_real_valves, refuse_without
from positioner.cli.real_league import play as play_on_real_valves
from positioner.cli.run_report import add_report, check_report, write_study
from positioner.cli.tables import add_output, note, show_result
from positioner.errors import BenchError, ExitCode
from positioner.laws.registry import LAWS, law_names
from positioner.machine.completion import suggest
from positioner.studies.conditions import known_plants

if TYPE_CHECKING:
    import argparse

    from positioner.cli.command import Commands
    from positioner.studies.league import LeagueSettings

_EPILOG = """\
examples:
  positioner league                                     every law, every plant, seeds 101 to 103, 1 kHz
  positioner league --short                             a part of it that takes about a minute
  positioner league --short --report league.html        and write it all into one HTML page
  positioner league --laws nmpc,paper --period 0.0001   at 10 kHz: about an hour on two cores
  positioner league --laws nmpc --setpoints reach       setpoints where the real valve can go, not the believed one
  positioner league --laws nmpc,nmpc-without-table --restart --plants stochastic
  positioner league --laws nmpc,examples/my_law.py:MyLaw    a law of your own: docs/own-law.md
  positioner league --real-valves                       valves with lags of 0 to 300 ms, and each goal: met or not
  positioner league --real-valves --short --tau 5,50    a quick look at two lags
  positioner league --real-valves --laws nmpc --plants paper --conditions told-dead-time-10

A law of yours that raises an error loses that bout: the others are played, and the error is told at the end (status 1).
`nmpc-without-table` is nmpc that never uses its stiction table. An interrupted league continues where it stopped. The
output directory then holds league.json, league.md, league.png and league.svg, or real-valves.json and so on.

exit status: 0 done, 1 a bout could not be played, 2 wrong command line, 78 a plant, law or file of setpoints is wrong.
"""


def add_parser(commands: Commands) -> None:
    """Add `positioner league`."""
    parser = add_command(commands, "league", _run, "compare all laws on all plants", _EPILOG)
    laws = parser.add_argument("--laws", metavar="A,B,…", help=f"laws, also FILE.py:NAME (default: {', '.join(LAWS)})")
    plants = parser.add_argument(
        "--plants",
        "--plant",
        metavar="A,B,…",
        help="plants, also FILE.toml or FILE.py:NAME (default: all variants of the nominal valve)",
    )
    suggest(laws, law_names, "*.py")
    suggest(plants, known_plants, "*.toml", "*.py")
    parser.add_argument("--seeds", metavar="N,M,…", help="seeds (default: 101,102,103)")
    add_signals(parser, "; with --real-valves the sensors 0.05,2: %% of span, %% of reading")
    parser.add_argument(
        "--restart", action="store_true", help="judge each law after a restart, with the table it learned"
    )
    parser.add_argument("--dwell", type=float, metavar="S", help="length of a dwell (default: 5 s)")
    parser.add_argument("--period", type=float, metavar="S", help="sample period (default: 0.001 s)")
    short = "other defaults: three laws, two plants, one seed, four dwells of 1 s"
    parser.add_argument("--short", action="store_true", help=short)
    add_real_valves(parser)
    add_output(parser)
    add_report(parser)
    add_study(parser, Path("league"))


def _run(arguments: argparse.Namespace) -> ExitCode:
    check_report(arguments)
    if arguments.real_valves:
        return play_on_real_valves(arguments)
    refuse_without(arguments)
    # matplotlib and the plant are needed here only
    from positioner.studies.conditions import reference_plant  # noqa: PLC0415
    from positioner.studies.league import play_league  # noqa: PLC0415
    from positioner.studies.league_picture import LeagueReport  # noqa: PLC0415
    from positioner.studies.league_report import blocks, write_report  # noqa: PLC0415
    from positioner.studies.standings import optimal_median_s, standings, summaries  # noqa: PLC0415

    settings = _settings(arguments)
    failed: dict[str, list[str]] = {}
    played = play_league(
        settings,
        arguments.out / "bouts",
        workers_of(arguments),
        lambda bout, failure: failed.setdefault(failure, []).append(f"{bout.plant}, seed {bout.seed}"),
    )
    failures = "\n".join(
        f"{failure}; {len(where)} of its bouts, the first on {where[0]}, are not in the figures"
        for failure, where in failed.items()
    )
    if not played:
        raise BenchError(failures)
    table = standings(played)
    reference = reference_plant(settings.plants)
    setpoints = settings.setpoints_of(reference)
    settle_s, rest_s = (None, None) if setpoints.edges_s else optimal_median_s(reference, setpoints.mm)
    report = LeagueReport(
        settings=settings,
        summaries=summaries(table, settle_s),
        standings=table,
        optimal_settle_1pct_s=settle_s,
        optimal_rest_s=rest_s,
    )
    write_report(arguments.out, report)
    show_result(arguments, blocks(report), (arguments.out / "league.json").read_text(encoding="utf-8"))
    note(f"\n{arguments.out}: league.json, league.md, league.png, league.svg")
    if arguments.report:
        from positioner.studies.report_page import league_verdict  # noqa: PLC0415

        write_study(arguments, "league", blocks(report), asdict(settings), league_verdict(report.summaries))
    if failures:
        raise BenchError(failures)
    return ExitCode.OK


def _settings(arguments: argparse.Namespace) -> LeagueSettings:
    """Return the settings of the whole league or of its short form, with the arguments in place of the defaults.

    Raises:
        UsageError: a name is unknown, or a number cannot be read.
    """
    from positioner.studies.conditions import NOMINAL, PLANTS, plants_in  # noqa: PLC0415
    from positioner.studies.entrants import entrants_in  # noqa: PLC0415
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
        "setpoints": arguments.setpoints,
        "noise": arguments.noise,
    }
    if arguments.laws:
        given["laws"] = entrants_in(arguments.laws)
    if arguments.plants:
        given["plants"] = plants_in(arguments.plants)
    if arguments.seeds is not None:
        given["seeds"] = tuple(dict.fromkeys(int(seed) for seed in numbers_in("seed", arguments.seeds, whole=True)))
    if arguments.setpoints:
        settings = replace(settings, setpoints_mm=None)
    return replace(settings, **{name: value for name, value in given.items() if value is not None})
