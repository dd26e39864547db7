"""`positioner health`: what the valve has done and how it changes, from its state directory or a log. Shell."""

from __future__ import annotations

import json
import shlex
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from positioner.cli.command import add_command, add_config, add_state, add_valve
from positioner.config.locations import location_of
from positioner.config.reader import load_config
from positioner.errors import ExitCode, StateError, UsageError
from positioner.health.alarm_text import alarm_as_json, alarm_lines, trend_lines, trends_as_json
from positioner.health.causes import AlarmCause
from positioner.health.counters_document import COUNTERS, counters_from
from positioner.health.counters_report import as_lines, as_values
from positioner.health.monitor import sections_of
from positioner.health.trends_document import TRENDS, trends_from, trends_in
from positioner.runtime.health_reference import measured_health_settings
from positioner.store import access

if TYPE_CHECKING:
    import argparse

    from positioner.cli.command import Commands
    from positioner.config.schema import Configuration
    from positioner.health.counters import Counters
    from positioner.health.monitor import HealthSettings
    from positioner.health.watch import Trends

_EPILOG = """\
examples:
  positioner health --config fv101.toml                       counters, histograms, trends and alarms
  positioner health --config fv101.toml --json                the same for programs
  positioner health --config fv101.toml --from bus.log        counted again from the record of a run
  positioner health --config fv101.toml --acknowledge all     a person has seen the alarms
  positioner health --config fv101.toml --reset               begin the counters anew, after a backup

Of a daemon that runs, the counters are at most 5 s old. A record of `positioner run --record` gives exactly the
counters of that run, from a new start; with --state, a copy of the state directory from before the run, it goes on from
the table and the counters there.

exit status: 0 done, 1 an alarm is active, 2 wrong command line, 74 nothing is kept yet, or it cannot be read, or the
log cannot, 78 the configuration is wrong.
"""


@dataclass(frozen=True, slots=True)
class _Found:
    """The sections of the health, since when and until when, and where they were found."""

    settings: HealthSettings
    counters: Counters
    trends: Trends
    sections: dict[str, Any]
    source: str
    started: str = ""
    saved: str = ""


def add_parser(commands: Commands) -> None:
    """Add `positioner health`."""
    summary = "show what the valve has done, how it changes, and its alarms"
    parser = add_command(commands, "health", _run, summary, _EPILOG)
    add_config(parser)
    add_valve(parser)
    add_state(parser)
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of text")
    parser.add_argument("--from", type=Path, metavar="LOG", dest="log", help="compute it again from a recorded run")
    parser.add_argument("--reset", action="store_true", help="begin the counters anew; the trends stay")
    parser.add_argument(
        "--acknowledge", metavar="CAUSE", help="a person has seen this alarm, such as friction_high, or all of them"
    )
    parser.add_argument("--yes", action="store_true", help="reset without a question")


def _run(arguments: argparse.Namespace) -> ExitCode:
    changes = "--reset" if arguments.reset else "--acknowledge"
    if (arguments.reset or arguments.acknowledge) and (arguments.log or arguments.json):
        raise UsageError(f"{changes} goes neither with --from nor with --json: it changes what the daemon keeps")
    configuration = load_config(arguments.config, valve=arguments.valve)
    if arguments.reset:
        return _reset(arguments, configuration)
    if arguments.acknowledge:
        return _acknowledge(arguments, configuration)
    found = _from_log(arguments, configuration) if arguments.log else _kept(arguments, configuration)
    if arguments.json:
        sys.stdout.write(json.dumps(_values(configuration, found), indent=2, ensure_ascii=False) + "\n")
    else:
        sys.stdout.write("\n".join(_lines(configuration, found)) + "\n")
    return ExitCode.FAILURE if any(alarm.is_active for alarm in found.trends.alarms) else ExitCode.OK


def _directory(arguments: argparse.Namespace, configuration: Configuration) -> Path:
    return location_of(configuration, arguments.config, arguments.state).state


def _kept(arguments: argparse.Namespace, configuration: Configuration) -> _Found:
    directory = _directory(arguments, configuration)
    document = access.health(directory)
    if document.valve_id != configuration.valve.id:
        raise StateError(f"{directory}: the health there is of valve {document.valve_id!r}, not of this one")
    settings = measured_health_settings(configuration, _notice, directory)
    return _found(settings, document.sections, directory, document.started, document.saved)


def _notice(line: str) -> None:
    sys.stderr.write(f"{line}\n")


def _found(
    settings: HealthSettings, sections: dict[str, Any], source: Path, started: str = "", saved: str = ""
) -> _Found:
    try:
        counters = counters_from(sections.get(COUNTERS))
        trends = trends_from(sections.get(TRENDS), settings.watch.reference)
        return _Found(settings, counters, trends, sections, str(source), started, saved)
    except (ValueError, KeyError, TypeError) as error:
        raise StateError(f"{source}: the health there cannot be used: {error}") from error


def _from_log(arguments: argparse.Namespace, configuration: Configuration) -> _Found:
    from positioner.replay.health_log import health_in  # noqa: PLC0415 - a log library, for a log only

    before = _kept(arguments, configuration).sections if arguments.state else {}
    state = _directory(arguments, configuration) if arguments.state else None
    settings = measured_health_settings(configuration, _notice, _directory(arguments, configuration))
    health, notices = health_in(arguments.log, configuration, settings, state, before)
    for notice in notices:
        sys.stderr.write(f"{arguments.log}: {notice}\n")
    return _found(settings, sections_of(health), arguments.log)


def _values(configuration: Configuration, found: _Found) -> dict[str, Any]:
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


def _lines(configuration: Configuration, found: _Found) -> list[str]:
    settings, trends = found.settings, found.trends
    since = f"counted since {found.started}" if found.started else "counted from the log"
    alarms = [f"  {line}" for alarm in trends.alarms for line in alarm_lines(alarm)]
    return [
        f"{configuration.valve.id}: {since}, in {found.source}",
        *("", "alarms" if alarms else "alarms: none", *alarms),
        *("", *trend_lines(settings.watch, trends), ""),
        *as_lines(settings.counters, found.counters),
    ]


def _reset(arguments: argparse.Namespace, configuration: Configuration) -> ExitCode:
    found, directory = _kept(arguments, configuration), _directory(arguments, configuration)
    if not arguments.yes:
        if not sys.stdin.isatty():
            raise StateError("--reset asks before it begins anew, and there is no terminal to ask on; give --yes")
        held = f"{configuration.valve.id}, {found.counters.cycles} cycles since {found.started}"
        if input(f"Begin the counters anew? {held} [y/N] ").strip().lower() not in {"y", "yes"}:
            sys.stdout.write("nothing was changed\n")
            return ExitCode.OK
    backup = access.reset_health(directory, (COUNTERS,))
    sys.stdout.write(f"the counters begin anew; the former ones are in {shlex.quote(backup)}\n")
    return ExitCode.OK


def _acknowledge(arguments: argparse.Namespace, configuration: Configuration) -> ExitCode:
    names = [cause.key for cause in AlarmCause]
    if arguments.acknowledge not in {"all", *names}:
        raise UsageError(f"--acknowledge {arguments.acknowledge}: no such alarm; one of all, {', '.join(names)}")
    found, directory = _kept(arguments, configuration), _directory(arguments, configuration)
    wanted = {cause for cause in AlarmCause if arguments.acknowledge in {"all", cause.key}}
    seen = [alarm.cause for alarm in found.trends.alarms if alarm.cause in wanted and not alarm.acknowledged]
    if not seen:
        sys.stdout.write("no such alarm waits to be acknowledged\n")
        return ExitCode.OK
    # one that is over stays, so that a daemon learns that it was acknowledged
    alarms = tuple(replace(each, acknowledged=True) if each.cause in seen else each for each in found.trends.alarms)
    access.change_health(directory, {TRENDS: trends_in(replace(found.trends, alarms=alarms))})
    sys.stdout.write(f"acknowledged: {', '.join(cause.key for cause in seen)}\n")
    return ExitCode.OK
