"""`positioner report`: one HTML page about a valve: verdict, measurements, use, settings. Shell."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from positioner.cli.check import summary_rows, warnings
from positioner.cli.command import add_command, add_config, add_max_size, add_state, add_valve
from positioner.cli.health_source import health_in_log, kept_health, service_of
from positioner.cli.tables import note, put
from positioner.commissioning import results
from positioner.config.locations import location_of
from positioner.config.reader import load_config
from positioner.errors import ExitCode, StateError, writing
from positioner.report.page import html
from positioner.report.procedure_page import KINDS
from positioner.report.valve_page import ValveReport, valve_page
from positioner.store import lock
from positioner.store.health_file import HEALTH

if TYPE_CHECKING:
    import argparse

    from positioner.cli.command import Commands
    from positioner.commissioning.results import KeptResult
    from positioner.config.schema import Configuration
    from positioner.report.trend_sections import Service

_EPILOG = """\
examples:
  positioner report --config fv101.toml                        write FV-101.html into this folder
  positioner report --config fv101.toml --out /tmp/fv101.html
  positioner report --config fv101.toml --state copy           of a copy of the state directory
  positioner report --config fv101.toml --from bus.log         counters, trend and alarms of that run

The page needs no network, opens in any browser and prints on two sheets of A4. It shows the newest kept result of each
test procedure over the reference, which is the first one, unless --as-reference of that procedure named another. It may
be made while the daemon runs. A part that was not measured yet names the command that measures it.

exit status: 0 done, 2 wrong command line, 74 a file cannot be read or written, 78 the configuration is wrong.
"""


def add_parser(commands: Commands) -> None:
    """Add `positioner report`."""
    summary = "write one HTML page about a valve: verdict, signature, step response, use, settings"
    parser = add_command(commands, "report", _run, summary, _EPILOG)
    add_config(parser)
    add_valve(parser)
    add_state(parser)
    parser.add_argument("--from", type=Path, metavar="LOG", dest="log", help="count the use in a recorded run instead")
    add_max_size(parser)
    parser.add_argument("--out", type=Path, metavar="FILE", help="the page (default: the valve's name, in this folder)")


def _run(arguments: argparse.Namespace) -> ExitCode:
    configuration = load_config(arguments.config, valve=arguments.valve)
    state = location_of(configuration, arguments.config, arguments.state).state
    options = f"--config {arguments.config}" + (f" --valve {arguments.valve}" if arguments.valve else "")
    told = [(name, text) for name, text in summary_rows(configuration, state) if name != "valve"]
    kept = _kept(state, configuration.valve.id)
    report = ValveReport(
        valve=configuration.valve.id,
        span_m=configuration.valve.span_m,
        made=datetime.now(UTC),
        results={kind: (own[-1], reference) for kind, (own, reference) in kept.items()},
        signatures=kept["signature"][0] if "signature" in kept else (),
        service=_service(arguments, state, configuration),
        facts=(*told, *results.versions().items()),
        options=options,
        running=_running(state),
        warnings=warnings(configuration),
    )
    path = arguments.out or Path(f"{configuration.valve.id}.html")
    with writing(path):
        path.write_text(html(valve_page(report)), encoding="utf-8")
    put(str(path))
    return ExitCode.OK


def _service(arguments: argparse.Namespace, state: Path, configuration: Configuration) -> Service | None:
    """Return what was counted, None where there is nothing; what cannot be used is told and left out."""
    if arguments.log:
        table = state if arguments.state else None
        most_mib: int = arguments.max_size
        return service_of(health_in_log(arguments.log, configuration, state, _notice, table=table, most_mib=most_mib))
    if not (state / HEALTH).exists():
        return None
    try:
        return service_of(kept_health(configuration, state, _notice))
    except StateError as error:
        note(f"{error}; the report goes without it")
    return None


def _notice(line: str) -> None:
    """Tell what is wrong with the reference of the health, but for the damaged files and other valves of `_kept`."""
    if results.FOLDER not in line and "is left out" not in line:
        note(line)


def _kept(state: Path, valve: str) -> dict[str, tuple[tuple[KeptResult, ...], KeptResult]]:
    """Return the kept results and the reference of each kind; results of another valve are told and left out."""
    found = {}
    for kind in KINDS:
        own = results.kept_of(state, kind, valve)
        reference = results.reference_of(state, own)
        if reference is not None:
            found[kind] = (own, reference)
    return found


def _running(state: Path) -> str:
    """Return the test procedure that has the state directory now, empty where none has it."""
    pid = lock.holder(state)
    if pid is None:
        return ""
    try:
        words = Path(f"/proc/{pid}/cmdline").read_bytes().decode(errors="replace").split("\0")
    except OSError:
        return ""
    return next((f"positioner {word}" for word in words if word in KINDS), "")
