"""`positioner replay`: the commands of a recorded bus computed again. Shell."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tqdm import tqdm

from positioner.cli.command import add_command, add_config, add_log, add_state, add_valve
from positioner.cli.names import add_law, law_of, shadow_of
from positioner.cli.tables import add_json, note, put, show, show_json
from positioner.config.reader import load_config
from positioner.errors import ExitCode, UsageError
from positioner.inputs.plug_in import anchored
from positioner.inputs.toml_reader import changes_of, laid_over
from positioner.replay.compare import Comparison
from positioner.replay.log import LogError
from positioner.replay.other import OtherLaw
from positioner.replay.prepare import prepare
from positioner.replay.report import as_json, headline, log_as_json, summary
from positioner.replay.run import replay_cycles
from positioner.replay.shadow import ReplayedShadow

if TYPE_CHECKING:
    import argparse

    from positioner.cli.command import Commands
    from positioner.config.schema import Configuration
    from positioner.replay.output import OutputFolder
    from positioner.replay.prepare import PreparedLog

_EPILOG = """\
examples:
  positioner replay out/bench/bus.log --config out/bench/valve.toml
  positioner replay bus.blf --config fv101.toml --state state-before
  positioner replay bus.log --config fv101.toml --law paper --set guard.max_rate_ma_per_s=500 --out what-if
  positioner replay bus.log --config fv101.toml --shadow quasi-static

The log may be candump (.log), ASC, BLF, CSV or another format that python-can reads. It must begin before the
positioner's first command; a log that starts later is refused. --law and --set show what another law or other settings
would have commanded, while the valve moves under the recorded commands. --shadow compares another law with the
configured one, as control.shadow does on a live valve: in each dwell the differences of current, and the moves of both.

exit status: 0 identical (with --law, --set or --shadow: done), 1 a frame differs, or the law of --shadow failed, 2 no
such law, 74 the log or the table cannot be read, or the log starts late, 78 the configuration is wrong.
"""


def add_parser(commands: Commands) -> None:
    """Add `positioner replay`."""
    parser = add_command(
        commands, "replay", _run, "compute the commands of a recorded bus again, and compare bit for bit", _EPILOG
    )
    add_log(parser)
    add_config(parser)
    add_valve(parser)
    add_state(parser, "start from the table in DIR, which is only read")
    which = parser.add_mutually_exclusive_group()
    add_law(which, "show what this law would have commanded")
    add_law(which, "compare this law with the configured one, dwell by dwell", option="--shadow")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        dest="changes",
        metavar="KEY=VALUE",
        help="change one setting, such as control.table_from_s=2 (repeatable)",
    )
    add_json(parser)
    parser.add_argument("--out", type=Path, metavar="DIR", help="write trace.csv, replay.png and replay.svg into DIR")


def _run(arguments: argparse.Namespace) -> ExitCode:
    changes = _changes(arguments)
    configuration = load_config(arguments.config, changes, arguments.valve)
    prepared = prepare(arguments.log, configuration, arguments.state, arguments.max_size)
    if arguments.shadow is not None:
        return _in_the_shadow(arguments, configuration, prepared)
    if not changes and not prepared.commands:
        text = "no command to compare with; --law shows what would have been commanded"
        raise LogError(f"{arguments.log}: holds {prepared.readings} position frames, and {text}")
    if not changes and prepared.late:
        text = "the earlier frames are missing, so commands cannot be compared; start the log before the positioner"
        raise LogError(
            f"{arguments.log}: starts late: {prepared.late}: {text}, or see with --law what would be commanded"
        )
    if not arguments.json:
        put(f"{headline(prepared)}")
    codec = configuration.make_codec()
    comparison, other = Comparison(codec, prepared.kind.has_instants), OtherLaw(codec)
    replayed_cycles = replay_cycles(configuration, prepared.cycles(), prepared.table, plays=True, follows=bool(changes))
    with _output(arguments.out) as output:
        for replayed in tqdm(
            replayed_cycles, "replay", prepared.cycle_count, unit=" cycles", delay=1, leave=False, disable=None
        ):
            comparison.add(replayed)
            row = other.add(replayed) if changes or output else None
            if output and row:
                output.add(row)
    if arguments.json:
        show_json(log_as_json(prepared) | other.as_json() if changes else as_json(prepared, comparison))
    else:
        put(f"{other.in_words() if changes else summary(prepared, comparison)}")
    if output:
        period_s = configuration.control.sample_period_s
        output.draw(f"{prepared.log.path}: law {configuration.control.law}, period {period_s * 1e3:g} ms")
        note(f"{arguments.out}: trace.csv, replay.png and .svg")
    return ExitCode.OK if changes or comparison.identical else ExitCode.FAILURE


def _changes(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return what the command line changes of the configuration; nothing runs in the shadow of the law of --law."""
    changes = changes_of(arguments.changes, "control.table_from_s=2")
    if law := law_of(arguments):
        changes = laid_over(changes, {"control": {"law": anchored(law, Path.cwd()), "shadow": ""}})
    if shadow := shadow_of(arguments):
        changes = laid_over(changes, {"control": {"shadow": anchored(shadow, Path.cwd())}})
    return changes


def _in_the_shadow(arguments: argparse.Namespace, configuration: Configuration, prepared: PreparedLog) -> ExitCode:
    """Compare the configured law with the one in its shadow, while the valve moves under the recorded commands."""
    if arguments.out is not None:
        raise UsageError("--out goes without --shadow: --law with --out draws the commands of one law")
    setup, law = configuration.make_setup(plays=True), configuration.make_shadow()
    assert law is not None  # noqa: S101 - its name was laid over the configuration
    shadow, recorded = ReplayedShadow(setup, law), OtherLaw(setup.codec)
    cycles = replay_cycles(configuration, prepared.cycles(), prepared.table, follows=True, setup=setup, shadow=shadow)
    for replayed in tqdm(cycles, "replay", prepared.cycle_count, unit=" cycles", delay=1, leave=False, disable=None):
        recorded.add(replayed)
    found = recorded.as_json()
    if arguments.json:
        show_json(log_as_json(prepared) | {"recorded": found} | shadow.as_json())
    else:
        put(headline(prepared))
        show(shadow.blocks())
    if found["first_difference"] is not None:
        text = "commands otherwise than it was recorded; replay without --shadow shows where"
        note(f"{configuration.control.law}, which the shadow is compared with, {text}")
    return ExitCode.FAILURE if shadow.failed else ExitCode.OK


def _output(folder: Path | None) -> contextlib.AbstractContextManager[OutputFolder | None]:
    if folder is None:
        return contextlib.nullcontext()
    from positioner.replay.output import OutputFolder  # noqa: PLC0415 - matplotlib would slow every other command down

    return OutputFolder(folder)
