"""`positioner replay`: a recorded bus through the same cycle. Shell."""

from __future__ import annotations

import argparse
import contextlib
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from tqdm import tqdm

from positioner.config.reader import load_config
from positioner.errors import ExitCode
from positioner.inputs.toml_reader import changes_of, laid_over
from positioner.laws.registry import LAWS
from positioner.replay.compare import Comparison
from positioner.replay.log import LogError
from positioner.replay.other import OtherLaw
from positioner.replay.report import headline, verdict
from positioner.replay.run import replayed
from positioner.replay.session import prepare

if TYPE_CHECKING:
    from positioner.replay.leave import Leaving

_EPILOG = """\
examples:
  positioner replay out/bench/bus.log --config out/bench/valve.toml
  positioner replay bus.blf --config fv101.toml --state state-before
  positioner replay bus.log --config fv101.toml --law paper --set guard.max_rate_ma_per_s=500 --out what-if

The log may be candump (.log), ASC, BLF, CSV or any other that python-can reads. It must begin before the positioner's
first command; one that starts late is refused. --law and --set ask what would have been: the law sees the valve as it
moved under the recorded commands, and says what it would have commanded.
exit status: 0 identical (or, with --law or --set, done), 1 a frame differs, 74 the log or the table cannot be read,
or the log starts late, 78 the configuration is wrong.
"""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    parser = subparsers.add_parser(
        "replay",
        help="do a recorded bus again",
        description="Feed a recorded bus through the same cycle, and compare its commands bit for bit.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("log", type=Path, metavar="LOG", help="the recorded bus")
    parser.add_argument("--config", type=Path, required=True, metavar="FILE", help="configuration of the valve (TOML)")
    parser.add_argument("--state", type=Path, metavar="DIR", help="start from the table in DIR, which is only read")
    parser.add_argument("--law", choices=tuple(LAWS), metavar="NAME", help="what would this law have done?")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        dest="changes",
        metavar="KEY=VALUE",
        help="change one setting, such as control.table_from_s=2 (repeatable)",
    )
    parser.add_argument("--out", type=Path, metavar="DIR", help="leave trace.csv and replay.png there")
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> ExitCode:
    changes = changes_of(arguments.changes, "control.table_from_s=2")
    if arguments.law:
        changes = laid_over(changes, {"control": {"law": arguments.law}})
    configuration = load_config(arguments.config, changes)
    session = prepare(arguments.log, configuration, arguments.state)
    if not changes and not session.commands:
        told = "no command among them to compare with; --law says what would have been commanded"
        raise LogError(f"{arguments.log}: holds {session.readings} position frames, and {told}")
    if not changes and session.late:
        told = "what the positioner knew before is not in it, and nothing can be compared; log it from its start"
        raise LogError(
            f"{arguments.log}: starts late: {session.late}: {told}, or ask with --law what would be commanded"
        )
    sys.stdout.write(f"{headline(session)}\n")
    codec = configuration.make_codec()
    comparison, other = Comparison(codec, session.kind.knows_instants), OtherLaw(codec)
    outcomes = replayed(configuration, session.turns(), session.table, follows=bool(changes))
    with _leaving(arguments.out) as leaving:
        for outcome in tqdm(outcomes, "replay", session.turn_count, unit=" turns", delay=1, leave=False, disable=None):
            comparison.take(outcome)
            row = other.take(outcome) if changes or leaving else None
            if leaving and row:
                leaving.take(row)
    sys.stdout.write(f"{other.in_words() if changes else verdict(session, comparison)}\n")
    if leaving:
        period_s = configuration.control.sample_period_s
        leaving.draw(f"{session.log.path}: law {configuration.control.law}, period {period_s * 1e3:g} ms")
        sys.stdout.write(f"{arguments.out}: trace.csv, replay.png\n")
    return ExitCode.OK if changes or comparison.identical else ExitCode.FAILURE


def _leaving(folder: Path | None) -> contextlib.AbstractContextManager[Leaving | None]:
    if folder is None:
        return contextlib.nullcontext()
    from positioner.replay.leave import Leaving  # noqa: PLC0415 - pictures slow every other command down

    return Leaving(folder)
