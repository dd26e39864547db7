"""A test procedure on the command line: options, the question before it, its run on the bus, progress. Shell."""

from __future__ import annotations

from contextlib import contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from tqdm import tqdm

from positioner.bus.address import parse_address
from positioner.cli.command import (
    add_config,
    add_max_size,
    add_state,
    add_valve,
    check_picture,
    refuse_without_folder,
)
from positioner.cli.question import agreed
from positioner.cli.tables import add_output, note
from positioner.commissioning import results
from positioner.commissioning.procedure import Procedure
from positioner.config.locations import location_of
from positioner.config.reader import load_config
from positioner.config.schema import StateSettings
from positioner.errors import AlreadyRunningError, UsageError, writing
from positioner.machine.journal import above, set_up
from positioner.machine.memory_lock import lock_memory
from positioner.store import lock

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable, Iterator, Sequence

    from positioner.commissioning.experiment import Experiment
    from positioner.commissioning.procedure import ProcedureLimits, Progress
    from positioner.commissioning.record import Stretch
    from positioner.commissioning.results import KeptResult
    from positioner.config.schema import Configuration
    from positioner.runtime.procedure_run import ProcedureRun

M = TypeVar("M")


def add_procedure(parser: argparse.ArgumentParser) -> None:
    """Add the options that every test procedure has."""
    add_config(parser)
    add_valve(parser)
    add_state(parser)
    parser.add_argument("--bus", metavar="INTERFACE:CHANNEL", help="bus instead of the configuration's")
    parser.add_argument("--yes", action="store_true", help="move the valve without a question, for scripts")
    parser.add_argument(
        "--from", type=Path, metavar="LOG", dest="log", help="evaluate this record of a test; nothing moves"
    )
    add_max_size(parser)
    parser.add_argument("--record", type=Path, metavar="FILE", help="record the test, for --from and replay")
    parser.add_argument("--report", type=Path, metavar="FILE", help="write the result as an HTML page")
    add_output(parser)
    parser.add_argument(
        "--as-reference", action="store_true", help="compare later results with this one (else with the first one)"
    )
    parser.add_argument(
        "--clock",
        choices=("realtime", "lockstep"),
        default="realtime",
        help="lockstep: one period for each position frame of an emulator (default: %(default)s)",
    )


def add_picture(parser: argparse.ArgumentParser, what: str) -> None:
    """Add `--picture`, which `keep_result` draws."""
    parser.add_argument("--picture", type=Path, metavar="FILE", help=f"draw {what} (PNG, SVG)")


def procedure_configuration(arguments: argparse.Namespace) -> Configuration:
    """Return the configuration, with the bus and the state directory of the command line."""
    refuse_without_folder("--report", arguments.report)
    check_picture(getattr(arguments, "picture", None))
    configuration = load_config(arguments.config, valve=arguments.valve)
    if arguments.bus:
        configuration = replace(configuration, bus=parse_address(arguments.bus))
    if arguments.state:
        configuration = replace(configuration, state=StateSettings(directory=arguments.state))
    return configuration


class OfferedProcedure(Procedure[M], Protocol):
    """A procedure that a person is asked about: its limits, and how long it is expected to last."""

    @property
    def limits(self) -> ProcedureLimits:
        """What it may do to the valve."""

    def expected_s(self) -> float:
        """Return how long it is expected to last, in s."""


def memory_of(arguments: argparse.Namespace, configuration: Configuration, procedure: OfferedProcedure[M]) -> M:
    """Return the procedure's memory at its end: from the log of --from, or on the bus after the person has agreed."""
    if arguments.log:
        from positioner.replay.procedure import memory_in  # noqa: PLC0415 - a log library, for a log only

        return memory_in(arguments.log, configuration, procedure, arguments.max_size)
    memory: M = _moved(arguments, configuration, procedure).result()
    return memory


def outcome_of(
    arguments: argparse.Namespace, configuration: Configuration, procedure: OfferedProcedure[M], told: str = ""
) -> tuple[M, str]:
    """Return the memory as `memory_of`, also where the procedure was ended early, and how the guard ended it.

    told: lines about this procedure that the person reads before the question.

    Raises:
        ProcedureError: it did not begin.
    """
    if arguments.log:
        from positioner.replay.procedure import outcome_in  # noqa: PLC0415 - a log library, for a log only

        return outcome_in(arguments.log, configuration, procedure, arguments.max_size)
    run = _moved(arguments, configuration, procedure, told)
    if run.remedy:
        note(f"{run.remedy}")
    return (run.result() if run.memory is None else run.memory), run.ended_because


def stretches_of(
    arguments: argparse.Namespace, configuration: Configuration, experiment: Experiment
) -> Sequence[Stretch]:
    """Return what the experiment recorded, as `memory_of`."""
    return memory_of(arguments, configuration, experiment).stretches


def keep_result(
    arguments: argparse.Namespace,
    configuration: Configuration,
    kind: str,
    document: dict[str, Any],
    *,
    finished: bool = True,
    picture: str = "",
    reference: KeptResult | None = None,
) -> None:
    """Write the report of a procedure, and keep the document of a finished one in the valve's state directory.

    The evaluation of an older record is kept only as the reference. picture: the title of the picture, which has the
    figures of the report; without one none is drawn. reference: with which it is compared, if not the kept one.

    Raises:
        StateError: a file cannot be written.
    """
    reference = reference or reference_of(arguments, configuration, kind)
    if picture and arguments.picture:
        _draw(arguments.picture, picture, kind, document, reference)
    if arguments.report:
        _write_report(arguments, configuration, kind, document, reference)
    if finished and (arguments.log is None or arguments.as_reference):
        path = results.keep(_state_of(arguments, configuration), kind, document, as_reference=arguments.as_reference)
        note(f"kept: {path}")


def _draw(path: Path, title: str, kind: str, document: dict[str, Any], reference: KeptResult | None) -> None:
    from positioner.cli.chart_picture import draw  # noqa: PLC0415 - matplotlib would slow every command down
    from positioner.report.procedure_page import charts_of  # noqa: PLC0415 - Jinja2 for figures only

    with writing(path):
        draw(path, title, charts_of(kind, document, reference.document if reference else None))
    note(f"picture: {path}")


def _write_report(
    arguments: argparse.Namespace,
    configuration: Configuration,
    kind: str,
    document: dict[str, Any],
    reference: KeptResult | None,
) -> None:
    from positioner.report.page import html  # noqa: PLC0415 - Jinja2 for a report only
    from positioner.report.procedure_page import procedure_page  # noqa: PLC0415

    guard = configuration.guard
    facts = (
        ("configuration", str(arguments.config)),
        ("record", str(arguments.log or arguments.record or "none")),
        ("current", f"{guard.current_low_ma:g} to {guard.current_high_ma:g} mA"),
        ("sample period", f"{configuration.control.sample_period_s * 1e3:g} ms"),
    )
    with writing(arguments.report):
        page = procedure_page(results.new_result(kind, document), reference, facts)
        arguments.report.write_text(html(page), encoding="utf-8")
    note(f"report: {arguments.report}")


def reference_of(arguments: argparse.Namespace, configuration: Configuration, kind: str) -> KeptResult | None:
    """Return the kept result with which a new one of this kind is compared, None where there is none.

    Raises:
        StateError: the state directory cannot be read.
    """
    return results.reference(_state_of(arguments, configuration), kind, configuration.valve.id)


def _state_of(arguments: argparse.Namespace, configuration: Configuration) -> Path:
    return location_of(configuration, arguments.config, arguments.state).state


def _moved(
    arguments: argparse.Namespace, configuration: Configuration, procedure: OfferedProcedure[M], told: str = ""
) -> ProcedureRun:
    """Return the run of the procedure after it has moved the valve on the bus, when the person has agreed to it."""
    from positioner.runtime.procedure_run import ProcedureRun  # noqa: PLC0415 - the bus, for an experiment only
    from positioner.runtime.session import RunOptions  # noqa: PLC0415

    _refuse_beside_a_daemon(arguments, configuration)
    results.check_writable(_state_of(arguments, configuration))
    note((_announcement(configuration, procedure) + told).rstrip())
    if not arguments.yes:
        _ask_whether_it_may_move()
    set_up(verbose=False)
    options = RunOptions(lockstep=arguments.clock == "lockstep", record=arguments.record)
    with bar(procedure.name) as show:

        def shown(progress: Progress) -> None:
            show(progress.part, progress.doing)

        lock_memory()
        run = ProcedureRun(configuration, options, procedure, shown)
        run.run()
    return run


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


def _announcement(configuration: Configuration, procedure: OfferedProcedure[M]) -> str:
    limits, valve = procedure.limits, configuration.valve
    rate = "free" if limits.rate_ma_per_s == float("inf") else f"{limits.rate_ma_per_s:g} mA/s at most"
    seconds = procedure.expected_s()
    return (
        f"{procedure.name} {valve.id} on {configuration.bus}: the valve will move, for about {seconds:.0f} s\n"
        f"  current  {limits.current_low_ma:g} to {limits.current_high_ma:g} mA, rate {rate} ([guard])\n"
        f"  travel   between the stops, {limits.travel_min_m * 1e3:g} to {limits.travel_max_m * 1e3:g} mm\n"
    )


def _ask_whether_it_may_move() -> None:
    """Ask whether the valve may be moved.

    Raises:
        UsageError: it may not, or there is nobody to ask.
    """
    nobody = UsageError("nobody is there to confirm it: add --yes, if the valve may be moved")
    if not agreed("May it move?", nobody):
        raise UsageError("not confirmed: nothing was moved")


@contextmanager
def bar(name: str) -> Iterator[Callable[..., None]]:
    """Yield a function that shows the part that is done, and what is done now."""
    with tqdm(total=1.0, desc=name, unit="", bar_format="{l_bar}{bar}| {unit}", leave=False, disable=None) as shown:

        def show(part: float, doing: str = "") -> None:
            shown.unit = doing  # a postfix begins with a comma
            shown.n = min(part, 1.0)
            shown.refresh()

        with above(shown) if not shown.disable else nullcontext():
            yield show
