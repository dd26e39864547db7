"""`positioner health`: what the valve has done and how it changes, from its state directory or a log. Shell."""

from __future__ import annotations

import shlex
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from positioner.cli.command import add_command, add_config, add_max_size, add_state, add_valve
from positioner.cli.health_source import FoundHealth, health_in_log, kept_health, service_of
from positioner.cli.question import agreed
from positioner.cli.tables import add_output, below, note, put, show, show_json
from positioner.commissioning import results
from positioner.config.locations import location_of
from positioner.config.reader import load_config
from positioner.errors import ExitCode, StateError, UsageError, writing
from positioner.health.alarm_text import alarm_as_json, alarm_lines, trend_line, trends_as_json
from positioner.health.causes import AlarmCause
from positioner.health.counters_document import COUNTERS
from positioner.health.counters_report import as_values, count_rows, histograms
from positioner.health.trends_document import TRENDS, trends_in
from positioner.health.watch import changes_of
from positioner.machine.completion import suggest
from positioner.report.table import Table
from positioner.report.trend_table import trend_table
from positioner.store import access

if TYPE_CHECKING:
    import argparse
    from collections.abc import Iterator

    from positioner.cli.command import Commands
    from positioner.config.schema import Configuration
    from positioner.report.text import Block

_EPILOG = """\
examples:
  positioner health --config fv101.toml                       counters, histograms, trends and alarms
  positioner health --config fv101.toml --json                the same for programs
  positioner health --config fv101.toml --report fv101.html   one page, with the verdict first
  positioner health --config fv101.toml --from bus.log        counted again from the record of a run
  positioner health --config fv101.toml --acknowledge all     a person has seen the alarms
  positioner health --config fv101.toml --reset               begin the counters anew, after a backup

Of a daemon that runs, the counters are at most 5 s old. A record of `positioner run --record` gives exactly the
counters of that run, from a new start; with --state, a copy of the state directory from before the run, it goes on from
the table and the counters there.

exit status: 0 done, 1 an alarm is active, 2 wrong command line, 74 nothing is kept yet, or it cannot be read, or the
log cannot, 78 the configuration is wrong.
"""


def add_parser(commands: Commands) -> None:
    """Add `positioner health`."""
    summary = "show what the valve has done, how it changes, and its alarms"
    parser = add_command(commands, "health", _run, summary, _EPILOG)
    add_config(parser)
    add_valve(parser)
    add_state(parser)
    add_output(parser)
    parser.add_argument("--from", type=Path, metavar="LOG", dest="log", help="compute it again from a recorded run")
    add_max_size(parser)
    parser.add_argument("--report", type=Path, metavar="FILE", help="write it as an HTML page")
    parser.add_argument("--reset", action="store_true", help="begin the counters anew; the trends stay")
    acknowledge = parser.add_argument(
        "--acknowledge",
        metavar="CAUSE",
        help="a person has seen this alarm, such as friction_high, or all of them: all",
    )
    suggest(acknowledge, _acknowledged)
    parser.add_argument("--yes", action="store_true", help="reset without a question")


def _run(arguments: argparse.Namespace) -> ExitCode:
    changes = "--reset" if arguments.reset else "--acknowledge"
    if (arguments.reset or arguments.acknowledge) and (arguments.log or arguments.json or arguments.report):
        raise UsageError(f"{changes} goes neither with --from, --json nor --report: it changes what the daemon keeps")
    configuration = load_config(arguments.config, valve=arguments.valve)
    if arguments.reset:
        return _reset(arguments, configuration)
    if arguments.acknowledge:
        return _acknowledge(arguments, configuration)
    found = _from_log(arguments, configuration) if arguments.log else _kept(arguments, configuration)
    if arguments.json:
        show_json(_values(configuration, found))
    else:
        show(_blocks(configuration, found), as_markdown=arguments.markdown)
    if arguments.report:
        _write_report(arguments, configuration, found)
    return ExitCode.FAILURE if any(alarm.is_active for alarm in found.trends.alarms) else ExitCode.OK


def _write_report(arguments: argparse.Namespace, configuration: Configuration, found: FoundHealth) -> None:
    from positioner.report.health_page import health_page  # noqa: PLC0415 - Jinja2 for a report only
    from positioner.report.page import html  # noqa: PLC0415

    valve = configuration.valve
    signatures = results.kept_of(_directory(arguments, configuration), "signature", valve.id, _quiet)
    facts = (("configuration", str(arguments.config)), ("source", found.source), *results.versions().items())
    options = f"--config {arguments.config}" + (f" --valve {arguments.valve}" if arguments.valve else "")
    page = health_page(valve.id, valve.span_m, datetime.now(UTC), service_of(found), signatures, facts, options)
    with writing(arguments.report):
        arguments.report.write_text(html(page), encoding="utf-8")
    note(f"report: {arguments.report}")


def _quiet(line: str) -> None:
    """Leave out what the reference of the health has told already."""


def _directory(arguments: argparse.Namespace, configuration: Configuration) -> Path:
    return location_of(configuration, arguments.config, arguments.state).state


def _kept(arguments: argparse.Namespace, configuration: Configuration) -> FoundHealth:
    return kept_health(configuration, _directory(arguments, configuration), note)


def _from_log(arguments: argparse.Namespace, configuration: Configuration) -> FoundHealth:
    directory = _directory(arguments, configuration)
    if not arguments.state:
        return health_in_log(arguments.log, configuration, directory, note, most_mib=arguments.max_size)
    before = _kept(arguments, configuration).sections
    return health_in_log(
        arguments.log, configuration, directory, note, table=directory, before=before, most_mib=arguments.max_size
    )


def _values(configuration: Configuration, found: FoundHealth) -> dict[str, Any]:
    return {
        "valve": configuration.valve.id,
        "source": found.source,
        "started": found.started or None,
        "saved": found.saved or None,
        "counters": as_values(found.settings.counters, found.counters),
        "alarms": [alarm_as_json(alarm) for alarm in found.trends.alarms],
        "trends": trends_as_json(found.settings.watch, found.trends),
        **{name: section for name, section in found.sections.items() if name not in {COUNTERS, TRENDS}},
    }


def _blocks(configuration: Configuration, found: FoundHealth) -> Iterator[Block]:
    """Yield the alarms, how friction and spring have changed, and what was counted."""
    settings, trends = found.settings, found.trends
    active = sum(alarm.is_active for alarm in trends.alarms)
    told = {0: "no alarm is active", 1: "an alarm is active"}.get(active, f"{active} alarms are active")
    yield f"{configuration.valve.id}: {told}"
    since = f"counted since {found.started}" if found.started else "counted from the log"
    yield f"{since}, in {found.source}"
    for alarm in trends.alarms:
        yield from below(alarm_lines(alarm))
    yield from ("", trend_line(settings.watch, trends), "")
    if trends.friction.moves:
        yield trend_table(changes_of(settings.watch, trends), settings.watch.limits)
        yield ""
    yield Table.of(("counter", "value", "", ""), count_rows(settings.counters, found.counters))
    for head, rows in histograms(found.counters):
        yield ""
        yield Table.of(head, rows) if rows else f"{head[0].partition(', ')[0]}: none yet"


def _reset(arguments: argparse.Namespace, configuration: Configuration) -> ExitCode:
    found, directory = _kept(arguments, configuration), _directory(arguments, configuration)
    if not arguments.yes:
        nobody = StateError("--reset asks before it begins anew, and there is no terminal to ask on; give --yes")
        held = f"{configuration.valve.id}, {found.counters.cycles} cycles since {found.started}"
        if not agreed(f"Begin the counters anew? {held}", nobody):
            put("nothing was changed")
            return ExitCode.OK
    backup = access.reset_health(directory, (COUNTERS,))
    put(f"the counters begin anew; the former ones are in {shlex.quote(backup)}")
    return ExitCode.OK


def _acknowledged() -> tuple[str, ...]:
    """Return what may be acknowledged."""
    return ("all", *(cause.key for cause in AlarmCause))


def _acknowledge(arguments: argparse.Namespace, configuration: Configuration) -> ExitCode:
    if arguments.acknowledge not in _acknowledged():
        known = ", ".join(_acknowledged())
        raise UsageError(f"--acknowledge {arguments.acknowledge}: no such alarm; one of {known}")
    found, directory = _kept(arguments, configuration), _directory(arguments, configuration)
    wanted = {cause for cause in AlarmCause if arguments.acknowledge in {"all", cause.key}}
    seen = [alarm.cause for alarm in found.trends.alarms if alarm.cause in wanted and not alarm.acknowledged]
    if not seen:
        put("no such alarm waits to be acknowledged")
        return ExitCode.OK
    # one that is over stays, so that a daemon learns that it was acknowledged
    alarms = tuple(replace(each, acknowledged=True) if each.cause in seen else each for each in found.trends.alarms)
    access.change_health(directory, {TRENDS: trends_in(replace(found.trends, alarms=alarms))})
    put(f"acknowledged: {', '.join(cause.key for cause in seen)}")
    return ExitCode.OK
