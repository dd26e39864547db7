"""`positioner identify`: spring, friction, lag and noise of a valve, by an experiment or from its log. Shell."""

from __future__ import annotations

import json
import sys
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from tqdm import tqdm

from positioner.bus.address import parse_address
from positioner.cli.command import add_command, add_config, add_state, add_valve
from positioner.commissioning.experiment import Experiment
from positioner.commissioning.identify import identify
from positioner.commissioning.procedure import ProcedureLimits
from positioner.commissioning.report import as_json, remarks, rows
from positioner.commissioning.units import PASCALS, area_m2, pressure_gain
from positioner.config.locations import location_of
from positioner.config.reader import load_config
from positioner.config.schema import StateSettings
from positioner.config.written_values import write_values
from positioner.errors import AlreadyRunningError, ExitCode, UsageError
from positioner.machine.journal import set_up
from positioner.machine.memory_lock import lock_memory
from positioner.store import lock

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable, Iterator, Sequence

    from positioner.cli.command import Commands
    from positioner.commissioning.procedure import Progress
    from positioner.commissioning.record import Stretch
    from positioner.config.schema import Configuration

_EPILOG = """\
examples:
  positioner identify --config fv101.toml                        show what the valve is, after a question
  positioner identify --config fv101.toml --write --picture fv101.png
  positioner identify --config fv101.toml --ip-range 3-15psi --area 100in2 --pressure-unit psi
  positioner identify --config fv101.toml --yes --record fv101.log
  positioner identify --config fv101.toml --from fv101.log       the same values from the record

It takes about two minutes, and moves the valve over the whole range that the guard's currents allow: isolate the valve,
or the process must bear it. The daemon of this valve must be stopped. No host is needed: it arms itself, and the status
says FUNCTION_CHECK meanwhile. Ctrl-C brings the stem back to where it was; a second Ctrl-C ends it at once. Afterwards
no commands are sent, and the actuator does what it does without them, as before.

exit status: 0 done, 1 aborted, or the record shows too little, 2 wrong command line, or not confirmed, 69 no bus, or
another controller, 74 a file cannot be written, 75 the daemon of this valve runs, 78 the configuration is wrong.
"""


def add_parser(commands: Commands) -> None:
    """Add `positioner identify`."""
    parser = add_command(
        commands, "identify", _run, "measure spring, friction, lag and noise of a valve, and configure them", _EPILOG
    )
    add_config(parser)
    add_valve(parser)
    add_state(parser)
    parser.add_argument("--bus", metavar="INTERFACE:CHANNEL", help="bus instead of the configuration's")
    parser.add_argument("--yes", action="store_true", help="move the valve without a question, for scripts")
    parser.add_argument("--write", action="store_true", help="write the values into the configuration, with a backup")
    parser.add_argument("--from", type=Path, metavar="LOG", dest="log", help="use the record of an identification")
    parser.add_argument("--record", type=Path, metavar="FILE", help="record the experiment, for --from and replay")
    parser.add_argument("--picture", type=Path, metavar="FILE", help="draw strokes, breakaways and steps (PNG)")
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    parser.add_argument("--ip-range", metavar="P-P", help="pressure at 4 and 20 mA, like 3-15psi or 0.2-1bar")
    parser.add_argument("--area", metavar="AREA", help="effective area of the diaphragm, like 100in2 or 645cm2")
    parser.add_argument(
        "--pressure-unit", choices=tuple(PASCALS), default="bar", help="of the bench set (default: %(default)s)"
    )
    parser.add_argument(
        "--clock",
        choices=("realtime", "lockstep"),
        default="realtime",
        help="lockstep: one period for each position frame of an emulator (default: %(default)s)",
    )


def _run(arguments: argparse.Namespace) -> ExitCode:
    configuration = _configuration(arguments)
    valve, period_s = configuration.valve, configuration.control.sample_period_s
    limits = ProcedureLimits.of(valve, configuration.guard)
    experiment = Experiment.of(valve, limits, period_s)
    if arguments.log:
        from positioner.replay.procedure import stretches_in  # noqa: PLC0415 - a log library, for a log only

        stretches: Sequence[Stretch] = stretches_in(arguments.log, configuration, experiment)
    else:
        stretches = _experiment(arguments, configuration, experiment)
    with _bar("fit") as show:
        found = identify(stretches, valve, limits, period_s, show)
    if arguments.json:
        sys.stdout.write(f"{json.dumps(as_json(found, valve, arguments.pressure_unit), indent=2)}\n")
    else:
        lines = [str(row) for row in rows(found, valve, arguments.pressure_unit)]
        head = f"{valve.id}, with 95 % intervals:"
        sys.stdout.write("\n".join([head, *lines, *(f"  {line}" for line in remarks(found))]) + "\n")
    if arguments.picture:
        from positioner.cli.identify_picture import draw  # noqa: PLC0415 - matplotlib would slow every command down

        draw(arguments.picture, stretches, found, configuration)
        sys.stderr.write(f"picture: {arguments.picture}\n")
    if arguments.write:
        tables = found.tables()
        for key, given in (("pressure_gain_pa_per_ma", arguments.ip_range), ("diaphragm_area_m2", arguments.area)):
            if given:
                tables["valve"][key] = getattr(valve, key)
        backup = write_values(arguments.config, tables, valve.id)
        sys.stderr.write(f"{arguments.config}: written; before it was as in {backup}\n")
    return ExitCode.OK


def _configuration(arguments: argparse.Namespace) -> Configuration:
    configuration = load_config(arguments.config, valve=arguments.valve)
    if arguments.bus:
        configuration = replace(configuration, bus=parse_address(arguments.bus))
    if arguments.state:
        configuration = replace(configuration, state=StateSettings(directory=arguments.state))
    valve = configuration.valve
    if arguments.ip_range:
        valve = replace(valve, pressure_gain_pa_per_ma=pressure_gain(arguments.ip_range))
    if arguments.area:
        valve = replace(valve, diaphragm_area_m2=area_m2(arguments.area))
    return replace(configuration, valve=valve)


def _experiment(
    arguments: argparse.Namespace, configuration: Configuration, experiment: Experiment
) -> Sequence[Stretch]:
    """Return what the experiment on the bus recorded, after the person has agreed to it."""
    from positioner.runtime.procedure_run import ProcedureRun  # noqa: PLC0415 - the bus, for an experiment only
    from positioner.runtime.session import RunOptions  # noqa: PLC0415

    _refuse_beside_a_daemon(arguments, configuration)
    sys.stderr.write(_announcement(configuration, experiment))
    if not arguments.yes:
        _ask()
    set_up(verbose=False)
    options = RunOptions(lockstep=arguments.clock == "lockstep", record=arguments.record)
    with _bar("experiment") as show:

        def shown(progress: Progress) -> None:
            show(progress.part, progress.doing)

        lock_memory()
        run = ProcedureRun(configuration, options, experiment, shown)
        run.run()
    stretches: Sequence[Stretch] = run.result().stretches
    return stretches


def _refuse_beside_a_daemon(arguments: argparse.Namespace, configuration: Configuration) -> None:
    """Refuse while another process has the valve's state directory.

    Raises:
        AlreadyRunningError: a daemon of this valve runs; the message has the command that stops it.
    """
    location = location_of(configuration, arguments.config, arguments.state)
    pid = lock.holder(location.state)
    if pid is not None:
        stop = f"systemctl stop {location.unit}" if location.unit else f"kill {pid}"
        raise AlreadyRunningError(f"the positioner of {configuration.valve.id} runs (process {pid}): stop it: {stop}")


def _announcement(configuration: Configuration, experiment: Experiment) -> str:
    limits, valve = experiment.limits, configuration.valve
    rate = "free" if limits.rate_ma_per_s == float("inf") else f"{limits.rate_ma_per_s:g} mA/s at most"
    seconds = experiment.expected_s()
    return (
        f"identify {valve.id} on {configuration.bus}: the valve will move, for about {seconds:.0f} s\n"
        f"  current  {limits.current_low_ma:g} to {limits.current_high_ma:g} mA, rate {rate} ([guard])\n"
        f"  travel   between the stops, {limits.travel_min_m * 1e3:g} to {limits.travel_max_m * 1e3:g} mm\n"
    )


def _ask() -> None:
    """Ask whether the valve may be moved.

    Raises:
        UsageError: it may not, or there is nobody to ask.
    """
    if sys.stdin is None or not sys.stdin.isatty():
        raise UsageError("nobody is there to confirm it: add --yes, if the valve may be moved")
    sys.stderr.write("May it move? Type yes: ")
    sys.stderr.flush()
    if sys.stdin.readline().strip().lower() not in {"y", "yes"}:
        raise UsageError("not confirmed: nothing was moved")


@contextmanager
def _bar(name: str) -> Iterator[Callable[..., None]]:
    """Yield a function that shows the part that is done, and what is done now."""
    with tqdm(total=1.0, desc=name, bar_format="{l_bar}{bar}| {postfix}", leave=False, disable=None) as bar:

        def show(part: float, doing: str = "") -> None:
            bar.set_postfix_str(doing, refresh=False)
            bar.n = min(part, 1.0)
            bar.refresh()

        yield show
