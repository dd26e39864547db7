"""`positioner step-test`: response times, overshoot, travel gain, dead band and resolution of a valve. Shell."""

from __future__ import annotations

from dataclasses import replace as replaced
from typing import TYPE_CHECKING

from positioner.cli.command import add_command, numbers_in
from positioner.cli.names import add_law
from positioner.cli.procedure import add_picture, add_procedure, keep_result, memory_of, procedure_configuration
from positioner.cli.tables import below, show, show_json
from positioner.commissioning.closed_loop import ClosedLoop
from positioner.commissioning.procedure import ProcedureLimits
from positioner.commissioning.step.curves import curves
from positioner.commissioning.step.hold import HoldLaw
from positioner.commissioning.step.limits import broken
from positioner.commissioning.step.plan import LADDER, OPEN_LADDER, OPEN_SIZES, REPEATS, SIZES, Plan
from positioner.commissioning.step.procedure import StepTest
from positioner.commissioning.step.report import BETWEEN, SIZE_HEAD, SIZE_NOTE, as_json, band_rows, heading, size_rows
from positioner.commissioning.step.result import result_of
from positioner.errors import ExitCode, UsageError
from positioner.laws.registry import law_names, law_problem
from positioner.report.quantities import quantity_table
from positioner.report.table import Table
from positioner.values import replace
from positioner.valve.credible import Limits

if TYPE_CHECKING:
    import argparse
    from collections.abc import Iterable, Iterator

    from positioner.cli.command import Commands
    from positioner.commissioning.step.result import StepResult
    from positioner.config.schema import Configuration
    from positioner.report.text import Block

_HOLD = "hold"
_EPILOG = """\
examples:
  positioner step-test --config fv101.toml                         in closed loop, with the configured law
  positioner step-test --config fv101.toml --sizes 1,10 --repeats 5
  positioner step-test --config fv101.toml --law hold              in open loop: the valve without a positioner
  positioner step-test --config fv101.toml --picture step.png
  positioner step-test --config fv101.toml --yes --record fv101.log
  positioner step-test --config fv101.toml --from fv101.log        the same values from the record

It steps around the middle of the valve's range, by 10 % of the span at most, and with --law hold over the whole range
of the current. The daemon of this valve must be stopped. The law begins with an empty stiction table, so that each test
begins alike; what it learns is not kept. Ctrl-C brings the stem back to where it was; a second one ends it at once.
Limits are in [step_test] of the configuration. --from wants the same options as the test. Percents are of the span
(valve.span_m); in open loop, with --law hold, of the signal from 4 to 20 mA.

exit status: 0 done, 1 aborted, or a limit is broken, 2 wrong command line, or not confirmed, 69 no bus, or another
controller, 74 a file cannot be written, 75 the daemon of this valve runs, 78 the configuration is wrong.
"""


def add_parser(commands: Commands) -> None:
    """Add `positioner step-test`."""
    parser = add_command(
        commands, "step-test", _run, "measure response times, overshoot, dead band and resolution of a valve", _EPILOG
    )
    add_procedure(parser)
    add_law(parser, f"law instead of the configuration's; {_HOLD}: no law, the currents step (open loop)", _HOLD)
    parser.add_argument(
        "--sizes",
        metavar="PERCENT,…",
        help=f"sizes of the steps (default: {_shown(SIZES)}; open: {_shown(OPEN_SIZES)})",
    )
    parser.add_argument(
        "--repeats", type=int, metavar="N", help=f"how often each size is stepped up and down (default: {REPEATS})"
    )
    parser.add_argument(
        "--wait", type=float, metavar="S", help="time after each step (default: 2 s, more for a slow valve)"
    )
    parser.add_argument(
        "--ladder",
        type=float,
        metavar="PERCENT",
        help="size of the small steps that show dead band and resolution; 0 leaves them out "
        f"(default: {_shown((LADDER,))}; open: {_shown((OPEN_LADDER,))})",
    )
    parser.add_argument(
        "--at",
        type=float,
        metavar="PERCENT",
        help="where the middle of the steps is (default: the middle of the range)",
    )
    add_picture(parser, "the responses, and times and gain by size")


def _shown(parts: Iterable[float]) -> str:
    return ",".join(f"{100.0 * each:g}" for each in parts)


def _run(arguments: argparse.Namespace) -> ExitCode:
    configuration = procedure_configuration(arguments)
    test = step_test_of(arguments, configuration)
    memory = memory_of(arguments, configuration, test)
    result = result_of(memory, test)
    valve = configuration.valve.id
    problems = broken(result, configuration.step_test)
    document = {
        **as_json(result, valve, problems),
        "limits": configuration.step_test.given(),
        "responses": curves(memory.responses, result),
    }
    if arguments.json:
        show_json(document)
    else:
        has_limits = bool(document["limits"])
        blocks: list[Block] = [heading(result, valve, has_limits=has_limits, broken=problems)]
        blocks += below(f"limit broken: {line}" for line in problems)
        show([*blocks, *_tables(result), *below(document["remarks"])], as_markdown=arguments.markdown)
    title = heading(result, valve, has_limits=False, broken=())
    keep_result(arguments, configuration, "step-test", document, picture=title)
    return ExitCode.FAILURE if problems else ExitCode.OK


def _tables(result: StepResult) -> Iterator[Block]:
    """Yield the sizes, and dead band and resolution with what the ladders leave open."""
    if result.rows:
        yield ""
        yield Table(SIZE_HEAD, tuple(size_rows(result)), SIZE_NOTE)
    bands = [row.as_json() for row in band_rows(result)]
    if bands:
        yield ""
        yield quantity_table(bands, between=BETWEEN)


def step_test_of(arguments: argparse.Namespace, configuration: Configuration) -> StepTest:
    """Return the test that the command line asks for.

    Raises:
        UsageError: a value is impossible.
    """
    is_open = arguments.law == _HOLD
    if arguments.law and not is_open:
        if problem := law_problem(arguments.law, (*law_names(), _HOLD)):
            raise UsageError(f"--law {arguments.law}: {problem}")
        configuration = replaced(configuration, control=replaced(configuration.control, law=arguments.law))
    valve, period_s = configuration.valve, configuration.control.sample_period_s
    limits = ProcedureLimits.of(valve, configuration.guard)
    plan = _plan(arguments, Plan.of(valve, limits, is_open=is_open), period_s)
    law = HoldLaw(valve.travel_min_m, valve.span_m) if is_open else configuration.make_law(plays=True)
    loop = ClosedLoop(law, Limits(configuration.valve), configuration.control.table_cell_m)
    return StepTest(valve, limits, period_s, plan, loop)


def _plan(arguments: argparse.Namespace, plan: Plan, period_s: float) -> Plan:
    """Return the plan with what the command line says.

    Raises:
        UsageError: the valve cannot do that.
    """
    if arguments.sizes is not None:
        plan = replace(plan, sizes=tuple(sorted({each / 100.0 for each in numbers_in("--sizes", arguments.sizes)})))
    if arguments.repeats is not None:
        plan = replace(plan, repeats=arguments.repeats)
    if arguments.wait is not None:
        plan = replace(plan, wait_s=arguments.wait)
    if arguments.ladder is not None:
        plan = replace(plan, ladder=arguments.ladder / 100.0)
    if arguments.at is not None:
        plan = replace(plan, place=arguments.at / 100.0)
    if problem := plan.problem(period_s):
        raise UsageError(problem)
    return plan
