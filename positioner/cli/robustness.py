"""`positioner robustness`: thousands of dwells of valves drawn at random, judged by their tails. Shell."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from positioner.cli.command import add_command, add_study, workers_of
from positioner.cli.tables import add_output, note, show_result
from positioner.errors import BenchError, ExitCode, UsageError, writing
from positioner.machine.completion import suggest
from positioner.studies.conditions import known_plants

if TYPE_CHECKING:
    import argparse

    from positioner.cli.command import Commands
    from positioner.robustness.cases import Case
    from positioner.robustness.space import Space
    from positioner.robustness.study import Study

_FOLDER = Path("robustness")
SETS = ("conditions", "forces", "lags", "periods", "physics", "rates", "restart", "wear")
"""Names of `robustness.sets`, which a help need not load."""
_SHORT_VALVES, _SHORT_DWELLS, _SHORT_BEYOND = 16, 8, 4
"""Of the short form: 16 valves of each of four classes with 8 dwells are 512 dwells."""
_SEEDS = {"tuning": 1, "release": 2}
"""Of the choice of valves: laws are never tuned on the second one."""

_EPILOG = """\
examples:
  positioner robustness --out out/robustness              10,000 dwells of nmpc and of four baselines
  positioner robustness --short                           500 dwells, in some minutes
  positioner robustness --set lags --laws nmpc,pi         one kind of difference, case by case
  positioner robustness --config fv101.toml --laws nmpc,two-move-retry    valves like this one: what does it risk?
  positioner robustness --plant examples/my_plant.py:LuGre --laws nmpc,pi --valves 4    on one plant, also of others
  positioner robustness --seeds release                   valves on which no law was tuned

The first law is judged, the others are its baselines: without one, a dwell that the law itself misses with the true
parameters counts as beyond reach, not as lost. An interrupted study continues where it stopped, and baselines
are kept as long as their code is the same. The output directory then holds report.md, report.json, lost.png,
factors.png, and worst/ with the scenario of each of the worst dwells. docs/robustness.md defines every figure.

--accept FILE keeps the figures; --accepted FILE compares with kept ones, and fails where a class became worse.

exit status: 0 done; 1 some run could not be played to its end, or worse than accepted; 78 the configuration is wrong.
"""


def add_parser(commands: Commands) -> None:
    """Add `positioner robustness`."""
    summary = "play valves, sensors, periods and forces drawn at random, and show the worst"
    parser = add_command(commands, "robustness", _run, summary, _EPILOG)
    parser.add_argument("--laws", metavar="A,B", help="the judged law, then its baselines (default: nmpc and four)")
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--set", choices=SETS, metavar="NAME", help=f"in place of random valves: {', '.join(SETS)}")
    which.add_argument("--config", type=Path, metavar="FILE", help="draw around this valve and its configuration")
    plant = which.add_argument(
        "--plant", metavar="NAME", help="one plant, or FILE.py:NAME; what is told of it is drawn"
    )
    suggest(plant, known_plants, "*.toml", "*.py")
    size = parser.add_mutually_exclusive_group()
    size.add_argument("--short", action="store_true", help="512 dwells in four classes")
    size.add_argument("--valves", type=int, metavar="N", help="valves of each class; of a set: cases of each kind")
    parser.add_argument("--seeds", choices=sorted(_SEEDS), default="tuning", help="which valves (default: %(default)s)")
    kept = parser.add_mutually_exclusive_group()
    kept.add_argument("--accept", type=Path, metavar="FILE", help="write the errors of the judged law into FILE")
    kept.add_argument("--accepted", type=Path, metavar="FILE", help="compare them with FILE")
    add_output(parser)
    add_study(parser, _FOLDER)


def _run(arguments: argparse.Namespace) -> ExitCode:
    from positioner.robustness import pictures, report  # noqa: PLC0415 - matplotlib is needed here only
    from positioner.robustness.study import BASELINES, OURS, play_study  # noqa: PLC0415
    from positioner.studies.entrants import entrants_in  # noqa: PLC0415

    laws = entrants_in(arguments.laws) if arguments.laws else (OURS, *BASELINES)
    cases, title = _cases(arguments)
    study = play_study(cases, laws, arguments.out / "runs", workers_of(arguments))
    bins = report.factor_bins(study)
    with writing(arguments.out):
        blocks = report.blocks(study, title)
        if bins:
            blocks += report.factor_blocks(study, bins)
            pictures.draw_factors(arguments.out / "factors.png", bins, f"{title}: error over each factor")
        blocks += report.worst_blocks(study, arguments.out)
        pictures.draw_lost(arguments.out / "lost.png", report.distributions(study), f"{title}: lost dwells")
        report.write(arguments.out, study, bins, blocks)
    show_result(arguments, blocks, report.as_json(study, bins))
    note(f"\n{arguments.out}: report.md, report.json, lost and factors (.png, .svg), worst/")
    if study.failures:
        raise BenchError(f"{len(study.failures)} runs ended before their time; report.json says why")
    return _judged(arguments, study)


def _cases(arguments: argparse.Namespace) -> tuple[list[Case], str]:
    from positioner.config.reader import load_config  # noqa: PLC0415
    from positioner.robustness.cases import BEYOND, CLASSES, NOMINAL, base_of, drawn  # noqa: PLC0415
    from positioner.robustness.sets import SETS as SETS_BY_NAME  # noqa: PLC0415
    from positioner.robustness.space import packaged_space  # noqa: PLC0415

    space, seed = packaged_space(), _SEEDS[arguments.seeds]
    if arguments.valves is not None and arguments.valves < 1:
        raise UsageError(f"--valves {arguments.valves}: at least 1 is needed")
    if arguments.set is not None:
        if arguments.short:
            raise UsageError(f"--short is about random valves: --set {arguments.set} is shorter with --valves 1")
        count = arguments.valves or 3
        return list(SETS_BY_NAME[arguments.set](space, count)), f"Robustness: {arguments.set}"
    if arguments.plant is not None:
        return _on_plant(arguments, seed)
    base = NOMINAL if arguments.config is None else base_of(load_config(arguments.config))
    space, valves, beyond = _size(space, arguments)
    cases = [
        case for group in CLASSES for case in drawn(space, group, beyond if group == BEYOND else valves, seed, base)
    ]
    around = "random valves" if arguments.config is None else f"valves around {arguments.config.name}"
    return cases, f"Robustness: {len(cases)} {around}, {arguments.seeds} seeds"


def _on_plant(arguments: argparse.Namespace, seed: int) -> tuple[list[Case], str]:
    """Return the cases on a given plant; nobody knows its reach, so that no setpoint is beyond it."""
    from positioner.robustness.cases import BEYOND, CLASSES, drawn  # noqa: PLC0415
    from positioner.robustness.given_plant import base_of_plant  # noqa: PLC0415
    from positioner.robustness.space import packaged_space  # noqa: PLC0415
    from positioner.studies.conditions import plant_mistake  # noqa: PLC0415

    if problem := plant_mistake(arguments.plant):
        raise UsageError(f"plant {arguments.plant!r} {problem}")
    base = base_of_plant(arguments.plant)
    space, valves, _ = _size(packaged_space(), arguments)
    cases = [case for group in CLASSES if group != BEYOND for case in drawn(space, group, valves, seed, base)]
    return cases, f"Robustness: {len(cases)} cases on {arguments.plant}, {arguments.seeds} seeds"


def _size(space: Space, arguments: argparse.Namespace) -> tuple[Space, int, int]:
    """Return the space, and the numbers of valves of a class and of the class beyond reach."""
    if arguments.short:
        return replace(space, dwells=_SHORT_DWELLS), _SHORT_VALVES, _SHORT_BEYOND
    if arguments.valves is not None:
        return space, arguments.valves, max(arguments.valves // 8, 1)
    return space, space.valves, space.beyond


def _judged(arguments: argparse.Namespace, study: Study) -> ExitCode:
    """Keep or compare the errors of the judged law."""
    from positioner.robustness.accepted import as_accepted, compared  # noqa: PLC0415

    if arguments.accept is not None:
        found = as_accepted(study.judged, study.verdicts)
        with writing(arguments.accept):
            arguments.accept.write_text(json.dumps(found, separators=(",", ":")) + "\n", encoding="utf-8")
        note(f"{arguments.accept}: accepted")
    if arguments.accepted is None:
        return ExitCode.OK
    try:
        before = json.loads(arguments.accepted.read_text(encoding="utf-8"))
        changes = compared(study.judged, study.verdicts, before)
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise UsageError(f"--accepted {arguments.accepted}: {error}; accept anew with --accept") from error
    for change in changes:
        note(f"{'worse: ' if change.worse else ''}{change.text}")
    if any(change.worse for change in changes):
        raise BenchError(f"worse than {arguments.accepted}: mend it, or accept it with --accept {arguments.accepted}")
    note(f"no class is worse than in {arguments.accepted}")
    return ExitCode.OK
