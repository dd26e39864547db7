"""`positioner explain`: why each command in a log was what it was. Shell."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from typing import TYPE_CHECKING

from tqdm import tqdm

from positioner.cli.command import add_command, add_config, add_log, add_state, add_valve
from positioner.cli.tables import add_output, finite, note, show, show_json
from positioner.config.reader import load_config
from positioner.diagnostics.explanation import Explainer
from positioner.diagnostics.explanation_text import MOVES_HEAD, command_lines, counts_line, move_row
from positioner.errors import ExitCode, UsageError
from positioner.replay.compare import Comparison, FrameCounters
from positioner.replay.log import LogError
from positioner.replay.prepare import prepare
from positioner.replay.recorded import command_in
from positioner.replay.report import headline
from positioner.replay.run import replay_cycles
from positioner.report.table import Table
from positioner.wire.messages import CurrentCommand

if TYPE_CHECKING:
    import argparse
    from collections.abc import Iterator

    from positioner.cli.command import Commands
    from positioner.config.schema import Configuration
    from positioner.diagnostics.explanation import ExplainedCommand
    from positioner.replay.prepare import PreparedLog

_EPILOG = """\
examples:
  positioner explain out/bench/bus.log --config out/bench/valve.toml              every move, and what bound it
  positioner explain out/bench/bus.log --config out/bench/valve.toml --at 1.204   the command at this instant
  positioner explain bus.log --config fv101.toml --state state-before --json

The commands are computed again, as replay does it. The instants are seconds since the log's first cycle. Where a
computed command differs from the recorded one, explain says so: then configuration, table or version are others.

exit status: 0 done, 1 a recorded command differs from the explained one, 2 no command at that instant, 74 the log or
the table cannot be read, or the log starts late, 78 the configuration is wrong.
"""


def add_parser(commands: Commands) -> None:
    """Add `positioner explain`."""
    parser = add_command(commands, "explain", _run, "tell why each command in a log was what it was", _EPILOG)
    add_log(parser)
    add_config(parser)
    add_valve(parser)
    add_state(parser, "start from the table in DIR, which is only read")
    parser.add_argument("--at", type=float, metavar="T", help="the newest command at this instant of the log, in s")
    add_output(parser)


def _run(arguments: argparse.Namespace) -> ExitCode:
    configuration = load_config(arguments.config, valve=arguments.valve)
    prepared = prepare(arguments.log, configuration, arguments.state, arguments.max_size)
    if prepared.late:
        raise LogError(f"{arguments.log}: starts late: {prepared.late}: start the log before the positioner")
    codec, explainer = configuration.make_codec(), Explainer()
    comparison = Comparison(codec, prepared.kind.has_instants)
    commands = _commands(configuration, prepared, explainer, comparison)
    if arguments.at is not None:
        _show_newest(arguments, commands)
    elif arguments.json:
        _write_all(commands, explainer)
    else:
        for _ in commands:
            pass
        table = Table.of(MOVES_HEAD, map(move_row, explainer.moves))
        show([headline(prepared), counts_line(explainer.counts), table], as_markdown=arguments.markdown)
    counters = comparison.counters.get(codec.by_kind[CurrentCommand].dbc.name, FrameCounters())
    differ = counters.recorded - counters.equal
    if differ:
        note(f"{differ} recorded commands differ from the explained ones: see positioner replay")
    return ExitCode.FAILURE if differ else ExitCode.OK


def _commands(
    configuration: Configuration, prepared: PreparedLog, explainer: Explainer, comparison: Comparison
) -> Iterator[ExplainedCommand]:
    """Yield every command of the log, explained."""
    begin_ns = None
    cycles = replay_cycles(configuration, prepared.cycles(), prepared.table)
    for cycle in tqdm(cycles, "explain", prepared.cycle_count, unit=" cycles", delay=1, leave=False, disable=None):
        begin_ns = cycle.recorded.time_ns if begin_ns is None else begin_ns
        time_s = (cycle.recorded.time_ns - begin_ns) * 1e-9
        comparison.add(cycle)
        computed = command_in(comparison.codec, cycle.computed)
        sent_ma = computed[0].current_ma if computed else None
        command = explainer.add(time_s, cycle.mode, cycle.events, sent_ma)
        if command is not None:
            yield command


def _show_newest(arguments: argparse.Namespace, commands: Iterator[ExplainedCommand]) -> None:
    """Print the newest command at the instant of --at.

    Raises:
        UsageError: there was none yet.
    """
    chosen = None
    for command in commands:
        chosen = command if command.time_s <= arguments.at else chosen
    if chosen is None:
        raise UsageError(f"{arguments.log}: no command until {arguments.at:g} s")
    if arguments.json:
        show_json(_as_json(chosen))
    else:
        show(command_lines(chosen), as_markdown=arguments.markdown)


def _write_all(commands: Iterator[ExplainedCommand], explainer: Explainer) -> None:
    """Print one JSON document. Of a long log the commands have no room in memory: they are written one by one."""
    comma = ""
    sys.stdout.write('{"commands": [')
    for command in commands:
        sys.stdout.write(f"{comma}\n{json.dumps(finite(_as_json(command)))}")
        comma = ","
    rest = {"moves": [asdict(move) for move in explainer.moves], "counts": explainer.counts}
    sys.stdout.write(f"\n],\n{json.dumps(finite(rest))[1:]}\n")


def _as_json(command: ExplainedCommand) -> dict[str, object]:
    controlled, move = command.controlled, command.move
    found: dict[str, object] = {
        "time_s": round(command.time_s, 9),
        "current_ma": command.current_ma,
        "mode": command.mode.name,
        "cause": command.cause.name,
        "bound": command.bound.value if command.bound else None,
        "fallback": command.fallback,
        "move": move.number if move else None,
    }
    if controlled:
        found |= {
            "control_time_s": controlled.time_s,
            "motion": controlled.decision.motion.name,
            "setpoint_m": controlled.setpoint_m,
            "measured_m": controlled.measured_m,
            "position_m": controlled.stem.position_m,
            "bounds": asdict(controlled.decision.bounds),
        }
    return found
