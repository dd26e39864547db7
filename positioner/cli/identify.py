"""`positioner identify`: spring, friction, lag and noise of a valve, by an experiment or from its log. Shell."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from positioner.cli.command import add_command, check_picture
from positioner.cli.procedure import add_procedure, bar, keep_result, procedure_configuration, stretches_of
from positioner.cli.tables import below, note, show, show_json
from positioner.commissioning.experiment import Experiment
from positioner.commissioning.identify import IdentifyError, identify
from positioner.commissioning.procedure import ProcedureLimits
from positioner.commissioning.report import as_json
from positioner.commissioning.units import PASCALS, area_m2, pressure_gain
from positioner.config.locations import location_of
from positioner.config.written_values import write_values
from positioner.errors import ExitCode, PositionerError
from positioner.report.quantities import quantity_table

if TYPE_CHECKING:
    import argparse

    from positioner.cli.command import Commands
    from positioner.config.schema import Configuration
    from positioner.report.text import Block

_EPILOG = """\
examples:
  positioner identify --config fv101.toml                        show what the valve is, after a question
  positioner identify --config fv101.toml --write --picture fv101.png
  positioner identify --config fv101.toml --ip-range 3-15psi --area 100in2 --pressure-unit psi
  positioner identify --config fv101.toml --yes --record fv101.log
  positioner identify --config fv101.toml --from fv101.log       the same values from the record
  positioner identify --config fv101.toml --from fv101.log --write --force   also where the fit does not explain it

It takes about two minutes, and moves the valve over the whole range that the guard's currents allow: isolate the valve,
or the process must bear it. The daemon of this valve must be stopped. No host is needed: it arms itself, and the status
says FUNCTION_CHECK meanwhile. Ctrl-C brings the stem back to where it was; a second Ctrl-C ends it at once. Afterwards
no commands are sent, and the actuator does what it does without them, as before. Then the record is evaluated, which
takes minutes of one processor; Ctrl-C ends that, too, and leaves the record. The result is kept in the state directory
of the valve.

A fit that does not explain its record is no result: it is shown, with the parts that it does not explain, but neither
written nor kept, and the exit status is 65. --force does both.

exit status: 0 done, 1 aborted, or the record shows too little, 2 wrong command line, or not confirmed, 65 the fitted
valve does not explain the record, 69 no bus, or another controller, 74 a file cannot be written, 75 the daemon of this
valve runs, 78 the configuration is wrong, 130 ended by Ctrl-C.
"""


def add_parser(commands: Commands) -> None:
    """Add `positioner identify`."""
    parser = add_command(
        commands, "identify", _run, "measure spring, friction, lag and noise of a valve, and configure them", _EPILOG
    )
    add_procedure(parser)
    parser.add_argument("--write", action="store_true", help="write the values into the configuration, with a backup")
    parser.add_argument("--force", action="store_true", help="write and keep values that do not explain the record")
    parser.add_argument("--picture", type=Path, metavar="FILE", help="draw strokes, breakaways and steps (PNG and SVG)")
    parser.add_argument("--ip-range", metavar="LOW-HIGH", help="pressures at 4 and 20 mA, like 3-15psi or 0.2-1bar")
    parser.add_argument("--area", metavar="AREA", help="effective area of the diaphragm, like 100in2 or 645cm2")
    parser.add_argument(
        "--pressure-unit", choices=tuple(PASCALS), default="bar", help="unit of the bench set (default: %(default)s)"
    )


class NotExplainedError(PositionerError):
    """The fitted valve does not explain its record; the message names the parts."""

    exit_code = ExitCode.DATA


def _run(arguments: argparse.Namespace) -> ExitCode:
    check_picture(arguments.picture)
    configuration = _configuration(arguments)
    valve, period_s = configuration.valve, configuration.control.sample_period_s
    limits = ProcedureLimits.of(valve, configuration.guard)
    experiment = Experiment.of(valve, limits, period_s)
    own_record = _own_record(arguments, configuration)
    stretches = stretches_of(arguments, configuration, experiment)
    try:
        with bar("fit") as tell:
            found = identify(stretches, valve, limits, period_s, tell)
    except (IdentifyError, KeyboardInterrupt):
        _tell_of_record(arguments)
        raise
    is_result = not found.unexplained or arguments.force
    document = as_json(found, valve, arguments.pressure_unit)
    if arguments.json:
        show_json(document)
    else:
        blocks: list[Block] = [
            f"{valve.id}: identification",
            "",
            quantity_table(document["rows"]),
            *below(document["remarks"]),
        ]
        show(blocks, as_markdown=arguments.markdown)
    if arguments.picture:
        from positioner.cli.identify_picture import draw  # noqa: PLC0415 - matplotlib would slow every command down

        draw(arguments.picture, stretches, found, configuration)
        note(f"picture: {arguments.picture}")
    if own_record is not None and is_result:
        own_record.unlink(missing_ok=True)
        arguments.record = None
    if arguments.write and is_result:
        tables = found.tables()
        for key, given in (("pressure_gain_pa_per_ma", arguments.ip_range), ("diaphragm_area_m2", arguments.area)):
            if given:
                tables["valve"][key] = getattr(valve, key)
        backup = write_values(arguments.config, tables, valve.id)
        note(f"{arguments.config}: written; before it was as in {backup}")
    keep_result(arguments, configuration, "identify", document, finished=is_result)
    if not is_result:
        _tell_of_record(arguments)
        parts = "; ".join(str(each) for each in found.unexplained)
        raise NotExplainedError(
            f"the fitted valve does not explain its record ({parts}): nothing was written or kept; look at --picture, "
            "and for what the model does not know; --force writes the values all the same"
        )
    return ExitCode.OK


def _own_record(arguments: argparse.Namespace, configuration: Configuration) -> Path | None:
    """Return where a test without --record is recorded, so that its evaluation can be ended; None with one."""
    if arguments.log or arguments.record:
        return None
    arguments.record = location_of(configuration, arguments.config, arguments.state).state / "identify.log"
    record: Path = arguments.record
    return record


def _tell_of_record(arguments: argparse.Namespace) -> None:
    if arguments.record:
        note(f"the record of this test: {arguments.record}; --from evaluates it")


def _configuration(arguments: argparse.Namespace) -> Configuration:
    configuration = procedure_configuration(arguments)
    valve = configuration.valve
    if arguments.ip_range:
        valve = replace(valve, pressure_gain_pa_per_ma=pressure_gain(arguments.ip_range))
    if arguments.area:
        valve = replace(valve, diaphragm_area_m2=area_m2(arguments.area))
    return replace(configuration, valve=valve)
