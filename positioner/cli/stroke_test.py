"""`positioner stroke-test`: a partial stroke of the valve, and whether it moves as it should. Shell."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.cli.command import add_command
from positioner.cli.procedure import (
    add_picture,
    add_procedure,
    keep_result,
    outcome_of,
    procedure_configuration,
    reference_of,
)
from positioner.cli.tables import below, show, show_json
from positioner.commissioning.closed_loop import ClosedLoop
from positioner.commissioning.procedure import ProcedureLimits
from positioner.commissioning.stroke.plan import places_m, plan_of
from positioner.commissioning.stroke.procedure import StrokeTest
from positioner.commissioning.stroke.report import as_json, compared, rows, verdict_line
from positioner.commissioning.stroke.result import Verdict, stroke_result
from positioner.errors import ExitCode
from positioner.report.quantities import quantity_table
from positioner.valve.credible import Limits

if TYPE_CHECKING:
    import argparse

    from positioner.cli.command import Commands
    from positioner.config.schema import Configuration
    from positioner.report.text import Block

KIND = "stroke-test"
_EPILOG = """\
examples:
  positioner stroke-test --config fv101.toml                       after a question
  positioner stroke-test --config fv101.toml --yes --json --report stroke.html
  positioner stroke-test --config fv101.toml --picture stroke.png
  positioner stroke-test --config fv101.toml --yes --record fv101.log
  positioner stroke-test --config fv101.toml --from fv101.log      the same result from the record

The test moves the valve from where it is by a tenth of its span, and back, within half a minute: the process must bear
it. Where the current cannot do that from there, it first moves to the nearest place from which it can, and back
afterwards, as far as the current reaches: the question names these places. [stroke_test] sets stroke, direction and
limits; the static friction that identify has written into [valve] is the reference. A new setpoint of the host, a
disarming and a trip end the test at once; the stem then goes where it is told. Any other end brings it back to where it
was, Ctrl-C too; a second Ctrl-C ends it at once. The daemon of this valve must be stopped; afterwards no commands are
sent. Results are kept in the state directory of the valve, and compared with the first one.

The test shows the condition of the valve. It earns no safety integrity level: the positioner is no safety device.

exit status: 0 passed, 1 failed or aborted, 2 wrong command line, or not confirmed, 69 no bus, or another controller,
74 a file cannot be written, 75 the daemon of this valve runs, 78 the configuration is wrong.
"""


def add_parser(commands: Commands) -> None:
    """Add `positioner stroke-test`."""
    summary = "stroke a valve partly and back, and tell whether it sticks or is slow"
    parser = add_command(commands, KIND, _run, summary, _EPILOG)
    add_procedure(parser)
    add_picture(parser, "travel and current during the stroke")


def stroke_test_of(configuration: Configuration) -> StrokeTest:
    """Return the procedure of a configuration."""
    control = configuration.control
    return StrokeTest(
        configuration.valve,
        ProcedureLimits.of(configuration.valve, configuration.guard),
        configuration.stroke_test,
        control.sample_period_s,
        ClosedLoop(configuration.make_law(plays=True), Limits(configuration.valve), control.table_cell_m),
    )


def _run(arguments: argparse.Namespace) -> ExitCode:
    configuration = procedure_configuration(arguments)
    valve, settings = configuration.valve, configuration.stroke_test
    reference = reference_of(arguments, configuration, KIND)
    test = stroke_test_of(configuration)
    memory, ended_by = outcome_of(arguments, configuration, test, _told(test))
    found = stroke_result(memory, ended_by, valve, settings, configuration.control.sample_period_s)
    finished = found.verdict is not Verdict.ABORTED
    document = as_json(found, valve, settings)
    if arguments.json:
        show_json(document)
    else:
        seen = [row.as_json() for row in rows(found) if row.seen]
        table = quantity_table(seen, compared(found, reference.document) if reference and finished else None)
        blocks: list[Block] = [verdict_line(found, valve), "", table, *below(document["remarks"])]
        show(blocks, as_markdown=arguments.markdown)
    title = f"{valve.id}: stroke test {found.verdict}"
    keep_result(arguments, configuration, KIND, document, finished=finished, picture=title, reference=reference)
    return ExitCode.OK if found.verdict is Verdict.PASSED else ExitCode.FAILURE


def _told(test: StrokeTest) -> str:
    """Return how far the stem goes, and where it goes first if it has to, as lines before the question."""
    settings, limits = test.settings, test.limits
    plan = plan_of(test.valve, limits, settings, test.period_s, limits.travel_min_m, 0.0)
    line = f"  stroke   {1e3 * plan.aim_m:.1f} mm {settings.direction}, and back\n"
    low_m, high_m = places_m(test.valve, limits, plan)
    if low_m > high_m or not settings.approach:
        return line
    places = f"{1e3 * low_m:.1f} to {1e3 * high_m:.1f} mm"
    return (
        line + f"  place    where it stands; outside of {places} it first moves there, and back at the end if it can\n"
    )
