"""`positioner signature`: spring, friction by place, hysteresis, bench set and seat load of a valve. Shell."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from positioner.cli.command import add_command
from positioner.cli.procedure import (
    add_picture,
    add_procedure,
    keep_result,
    procedure_configuration,
    reference_of,
    stretches_of,
)
from positioner.cli.tables import below, show, show_json
from positioner.commissioning.procedure import ProcedureLimits
from positioner.commissioning.results import KeptResult
from positioner.commissioning.signature import signature
from positioner.commissioning.signature_limits import Beyond, beyond_limits
from positioner.commissioning.signature_report import as_json, fitted_lines, loop_points
from positioner.commissioning.signature_stages import signature_experiment
from positioner.commissioning.units import PASCALS
from positioner.errors import ExitCode, UsageError
from positioner.report.quantities import quantity_table

if TYPE_CHECKING:
    import argparse

    from positioner.cli.command import Commands
    from positioner.commissioning.signature import Signature
    from positioner.config.schema import Configuration
    from positioner.report.text import Block

_EPILOG = """\
examples:
  positioner signature --config fv101.toml --picture signature.png
  positioner signature --config fv101.toml --as-reference              compare later signatures with this one
  positioner signature --config fv101.toml --reference first.json      compare with a file of --json
  positioner signature --config fv101.toml --yes --record fv101.log
  positioner signature --config fv101.toml --from fv101.log            the same values from the record

It takes about three minutes, and moves the valve slowly over the whole range that the guard's currents allow: isolate
the valve, or the process must bear it. The daemon of this valve must be stopped. Ctrl-C brings the stem back to
where it was; a second one ends it at once. Lag and viscous friction are the configured ones: identify measures them.
The result is kept in the valve's state directory; the first one is the reference, which shows what has changed. The
limits of the changes are those of [health]: friction_high, friction_low, spring_rate and spring_force.

exit status: 0 done, 1 a limit is broken, aborted, or the strokes show too little, 2 wrong command line, or not
confirmed, 69 no bus, or another controller, 74 a file cannot be written, 75 the daemon of this valve runs, 78 the
configuration is wrong.
"""


def add_parser(commands: Commands) -> None:
    """Add `positioner signature`."""
    parser = add_command(
        commands, "signature", _run, "measure a valve's signature: spring, friction by place, bench set", _EPILOG
    )
    add_procedure(parser)
    parser.add_argument(
        "--rate",
        type=float,
        default=0.0,
        metavar="MA_PER_S",
        help="rate of the slow strokes, in mA/s (default: the slowest that the stem follows)",
    )
    add_picture(parser, "the loop, and the friction along the travel")
    parser.add_argument(
        "--reference", type=Path, metavar="FILE", help="an earlier --json, instead of the kept reference"
    )
    parser.add_argument(
        "--pressure-unit", choices=tuple(PASCALS), default="bar", help="unit of the bench set (default: %(default)s)"
    )


def _run(arguments: argparse.Namespace) -> ExitCode:
    if arguments.rate < 0.0:
        raise UsageError(f"--rate {arguments.rate:g}: must be more than 0 mA/s")
    given = _given(arguments.reference)
    configuration = procedure_configuration(arguments)
    kept = given or reference_of(arguments, configuration, "signature")
    reference = kept.document if kept else None
    valve, period_s = configuration.valve, configuration.control.sample_period_s
    limits = ProcedureLimits.of(valve, configuration.guard)
    experiment = signature_experiment(valve, limits, period_s, arguments.rate)
    stretches = stretches_of(arguments, configuration, experiment)
    found = signature(stretches, valve, limits, period_s)
    beyond = _beyond(found, reference, configuration)
    document = {
        **as_json(found, valve, arguments.pressure_unit),
        "loop": loop_points(found.strokes),
        "fitted": fitted_lines(found, valve),
        "compared": reference is not None,
        "beyond_limits": [each.as_json() for each in beyond],
    }
    if arguments.json:
        show_json(document)
    else:
        table = quantity_table(document["rows"], reference["rows"] if reference else None)
        blocks: list[Block] = [*_verdict(valve.id, reference, beyond), "", table, *below(document["remarks"])]
        show(blocks, as_markdown=arguments.markdown)
    title = f"{valve.id}: signature at {found.rate_ma_per_s:.3g} mA/s"
    keep_result(arguments, configuration, "signature", document, picture=title, reference=kept)
    return ExitCode.FAILURE if beyond else ExitCode.OK


def _verdict(valve: str, reference: dict[str, Any] | None, beyond: tuple[Beyond, ...]) -> list[str]:
    """Return whether the changes since the reference keep the limits, and a line for each that does not."""
    if reference is None:
        return [f"{valve}: signature"]
    kept = "beyond the limits" if beyond else "within the limits"
    return [f"{valve}: signature, changed {kept} of [health] since the reference", *map(str, beyond)]


def _beyond(found: Signature, reference: dict[str, Any] | None, configuration: Configuration) -> tuple[Beyond, ...]:
    """Return what has changed beyond the limits of [health] since the reference, nothing without one.

    Raises:
        UsageError: the reference is no complete signature.
    """
    if reference is None:
        return ()
    try:
        return beyond_limits(found, reference, configuration.health, configuration.valve.span_m)
    except (KeyError, TypeError, ValueError) as error:
        raise UsageError(
            f"the reference is no complete signature ({error}): measure one with --as-reference"
        ) from error


def _given(path: Path | None) -> KeptResult | None:
    """Return an earlier signature, of the instant at which its file was written.

    Raises:
        UsageError: the file is none.
    """
    if path is None:
        return None
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        written = datetime.fromtimestamp(path.stat().st_mtime, UTC)
        known = all(isinstance(each, float | int | None) for each in found["quantities"].values())
        numbers = [row["value"] for row in found["rows"] if isinstance(row["name"], str)]
        known = (
            known and all(each is None or each * 0.0 == 0.0 for each in numbers) and len(numbers) == len(found["rows"])
        )
        places = [[float(x), float(f)] for x, f in found["sliding_friction_by_place"]]
    except OSError as error:
        raise UsageError(f"--reference {path}: cannot be read: {error.strerror}") from error
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise UsageError(f"--reference {path}: is no signature ({error}): write one with --json") from error
    if not known or not places:
        raise UsageError(f"--reference {path}: is no signature: write one with --json")
    return KeptResult("signature", str(path), str(found.get("valve", "")), written, {}, dict(found))
