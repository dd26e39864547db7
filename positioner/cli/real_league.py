"""`positioner league --real-valves`: laws on valves whose actuator lags. Shell."""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

from positioner.cli.command import numbers_in, workers_of
from positioner.cli.run_report import write_study
from positioner.cli.tables import note, show_result
from positioner.errors import ExitCode, UsageError
from positioner.inputs.nearest import names_in
from positioner.machine.completion import suggest

if TYPE_CHECKING:
    import argparse

    from positioner.studies.real_valves.bouts import RealLeagueSettings

_ONLY_HERE = ("tau", "rival_plants", "exact", "conditions")


def add_real_valves(parser: argparse.ArgumentParser) -> None:
    """Add `--real-valves` and its options."""
    parser.add_argument(
        "--real-valves", action="store_true", help="play on valves whose actuators lag, each identified before"
    )
    parser.add_argument(
        "--tau", metavar="MS,MS,…", help="real valves: lags of the actuators, in ms (default: 0,2,5,10,20,50,100,300)"
    )
    rival_plants = parser.add_argument(
        "--rival-plants", metavar="A,B,…", help="real valves: plants of the other laws than nmpc (default: all)"
    )
    parser.add_argument("--exact", action="store_true", help="real valves: exact parameters instead of identified ones")
    conditions = parser.add_argument(
        "--conditions", metavar="A,B,…", help="real valves: what else to play: all, none, or names (default: all)"
    )
    suggest(rival_plants, _plants)
    suggest(conditions, _conditions)


def _plants() -> tuple[str, ...]:
    from positioner.studies.real_valves.valves import ALL_PLANTS  # noqa: PLC0415 - the plant

    return ALL_PLANTS


def _conditions() -> tuple[str, ...]:
    from positioner.studies.real_valves.conditions import CONDITIONS  # noqa: PLC0415 - the plant

    return ("all", "none", *CONDITIONS)


def refuse_without(arguments: argparse.Namespace) -> None:
    """Refuse the options of real valves in another league.

    Raises:
        UsageError: one was given.
    """
    for name in _ONLY_HERE:
        if getattr(arguments, name):
            raise UsageError(f"--{name.replace('_', '-')} needs --real-valves")


def play(arguments: argparse.Namespace) -> ExitCode:
    """Play the league on real valves, and write its files.

    Raises:
        UsageError: a name is unknown, or a number cannot be read.
    """
    from positioner.studies.real_valves.league import play_real_league  # noqa: PLC0415 - matplotlib and the plant
    from positioner.studies.real_valves.report import RealReport, blocks, write_report  # noqa: PLC0415

    settings = _settings(arguments)
    results = play_real_league(settings, arguments.out / "bouts", workers_of(arguments))
    report = RealReport(settings=settings, results=results)
    write_report(arguments.out, report)
    show_result(arguments, blocks(report), (arguments.out / "real-valves.json").read_text(encoding="utf-8"))
    note(f"\n{arguments.out}: real-valves.json, real-valves.md, real-valves.png, real-valves.svg")
    if arguments.report:
        from positioner.studies.real_valves.goals import judged  # noqa: PLC0415
        from positioner.studies.report_page import goals_verdict  # noqa: PLC0415

        verdict = goals_verdict(judged(results))
        write_study(arguments, "real-valves", blocks(report), asdict(settings), verdict)
    return ExitCode.OK


def _settings(arguments: argparse.Namespace) -> RealLeagueSettings:
    from positioner.studies.real_valves.bouts import RIVALS, SEEDS, RealLeagueSettings  # noqa: PLC0415 - the plant
    from positioner.studies.real_valves.conditions import CONDITIONS  # noqa: PLC0415
    from positioner.studies.real_valves.valves import ALL_PLANTS, LAGS_S, NOISES, PLANTS  # noqa: PLC0415

    if arguments.restart:
        raise UsageError("--restart does not go with --real-valves")
    if arguments.setpoints:
        raise UsageError("--setpoints does not go with --real-valves: they lie in the range of each plant")
    settings = RealLeagueSettings(
        laws=("nmpc", *RIVALS),
        plants=ALL_PLANTS,
        rival_plants=ALL_PLANTS,
        lags_s=LAGS_S,
        noises=tuple(NOISES),
        seeds=SEEDS,
        conditions=tuple(CONDITIONS),
        identified=not arguments.exact,
    )
    if arguments.short:
        settings = replace(
            settings,
            laws=("nmpc", "two-move-retry"),
            plants=PLANTS[:1],
            rival_plants=PLANTS[:1],
            lags_s=(0.0, 0.02),
            noises=("0.05",),
            seeds=SEEDS[:1],
            conditions=(),
            setpoints=4,
            identified=False,
            dwell_s=2.0,
        )
    return replace(settings, **{name: value for name, value in _given(arguments).items() if value is not None})


def _given(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the settings that the command line gives; None where it gives none."""
    from positioner.studies.entrants import entrants_in  # noqa: PLC0415 - the plant
    from positioner.studies.real_valves.conditions import CONDITIONS  # noqa: PLC0415
    from positioner.studies.real_valves.valves import ALL_PLANTS, NOISES  # noqa: PLC0415

    def names(what: str, text: str | None, known: tuple[str, ...]) -> tuple[str, ...] | None:
        return None if text is None else names_in(what, text, known)

    def numbers(what: str, text: str | None, *, whole: bool = False) -> tuple[float, ...] | None:
        return None if text is None else tuple(dict.fromkeys(numbers_in(what, text, whole=whole)))

    lags_ms, seeds = numbers("tau", arguments.tau), numbers("seed", arguments.seeds, whole=True)
    plants = names("plant", arguments.plants, ALL_PLANTS)
    special = {"all": tuple(CONDITIONS), "none": ()}
    return {
        "laws": None if arguments.laws is None else entrants_in(arguments.laws),
        "plants": plants,
        "rival_plants": names("plant", arguments.rival_plants, ALL_PLANTS) or plants,
        "lags_s": lags_ms and tuple(lag_ms / 1e3 for lag_ms in lags_ms),
        "noises": names("noise", arguments.noise, tuple(NOISES)),
        "seeds": seeds and tuple(int(seed) for seed in seeds),
        "conditions": special[arguments.conditions]
        if arguments.conditions in special
        else names("condition", arguments.conditions, tuple(CONDITIONS)),
        "dwell_s": arguments.dwell,
        "period_s": arguments.period,
    }
