"""`positioner check`: every mistake of a configuration at once. Shell."""

from __future__ import annotations

import sys
from dataclasses import asdict
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

from positioner.cli.command import add_command
from positioner.cli.tables import add_output, below, show, show_json
from positioner.config.locations import location_of
from positioner.config.reader import load_valves
from positioner.config.several import by_bus
from positioner.doctor import bus_load
from positioner.doctor.finding import Level
from positioner.errors import ConfigurationError, ExitCode
from positioner.inputs.durations import duration
from positioner.laws.registry import is_outside
from positioner.reach.expected import in_words
from positioner.report.table import Table

if TYPE_CHECKING:
    import argparse
    from collections.abc import Sequence

    from positioner.cli.command import Commands
    from positioner.config.schema import Configuration
    from positioner.doctor.finding import Finding
    from positioner.report.text import Block
    from positioner.valve.parameters import ValveParameters

_EPILOG = """\
examples:
  positioner check /etc/positioner/fv101.toml
  positioner check --example > fv101.toml       write a commented configuration to start from
  positioner check fv101.toml --json            mistakes and properties for programs

exit status: 0 good, perhaps with warnings, 78 a mistake is in it, or it cannot be read.
"""


def add_parser(commands: Commands) -> None:
    """Add `positioner check`."""
    parser = add_command(
        commands, "check", _run, "check a configuration: all mistakes at once, each with its line", _EPILOG
    )
    which = parser.add_mutually_exclusive_group(required=True)
    which.add_argument("config", nargs="?", type=Path, metavar="FILE.toml", help="the configuration")
    which.add_argument("--example", action="store_true", help="print a commented configuration")
    add_output(parser)


def _run(arguments: argparse.Namespace) -> ExitCode:
    if arguments.example:
        sys.stdout.write(example_text())
        return ExitCode.OK
    if arguments.json:
        return _as_json(arguments.config)
    configurations = load_valves(arguments.config, places=True)
    told = [f"{each.valve.id}: {line}" for each in configurations for line in warnings(each)]
    shared = _shared_buses(configurations)
    told += [each.text for each in shared if each.level is not Level.OK]
    blocks: list[Block] = [verdict(arguments.config, len(told)), *below(told)]
    for each in configurations:
        blocks += ["", Table.of(("", ""), summary_rows(each, location_of(each, arguments.config).state))]
    loads = [line for each in shared if each.level is Level.OK for line in ("", f"{each.subject} of {each.text}")]
    show([*blocks, *loads], as_markdown=arguments.markdown)
    return ExitCode.OK


def verdict(path: Path, warned: int) -> str:
    """Return the first line of what is told of a configuration without a mistake, but with so many warnings."""
    return f"{path}: no mistake, but {warned} warning{'s' * (warned > 1)}" if warned else f"{path}: good"


def _as_json(path: Path) -> ExitCode:
    """Print mistakes, or the properties of each valve, as one document; return the exit status."""
    try:
        configurations = load_valves(path, places=True)
    except ConfigurationError as error:
        mistakes = [asdict(problem) for problem in error.problems]
        show_json({"file": str(path), "good": False, "mistakes": mistakes, "warnings": [], "valves": []})
        return error.exit_code
    valves = [values(each, location_of(each, path).state) for each in configurations]
    shared = [each.text for each in _shared_buses(configurations) if each.level is not Level.OK]
    show_json({"file": str(path), "good": True, "mistakes": [], "warnings": shared, "valves": valves})
    return ExitCode.OK


def values(configuration: Configuration, state: Path) -> dict[str, Any]:
    """Return the main properties of the configured valve for a program, in SI units; `state` holds its table."""
    valve, guard, period_s = configuration.valve, configuration.guard, configuration.control.sample_period_s
    low_m, high_m = restartable_m(configuration)
    load = bus_load.bus_load(configuration.make_codec(), period_s, bus_load.FASTEST)
    return {
        "valve": valve.id,
        "span_m": valve.span_m,
        "restartable_low_m": low_m,
        "restartable_high_m": high_m,
        "static_friction_of_span_force": valve.static_friction_n / _span_force_n(configuration),
        "slip_jump_m": (valve.static_friction_n - valve.coulomb_friction_n) / valve.spring_rate_n_per_m,
        "law": configuration.control.law,
        "shadow": configuration.control.shadow,
        "sample_period_s": period_s,
        "actuator_deadman_s": guard.actuator_deadman_s or None,
        "bus": str(configuration.bus),
        "bus_load_at_1_mbit_per_s": load.total,
        "state": str(state),
        "warnings": list(warnings(configuration)),
    }


def restartable_m(configuration: Configuration) -> tuple[float, float]:
    """Return the ends in m of the range in which currents within the limits free the stem both ways, beyond stops."""
    valve, guard = configuration.valve, configuration.guard
    low_n = valve.force_gain_n_per_ma * guard.current_low_ma - valve.bench_set_n
    high_n = valve.force_gain_n_per_ma * guard.current_high_ma - valve.bench_set_n
    friction_n = valve.static_friction_n
    return (low_n + friction_n) / valve.spring_rate_n_per_m, (high_n - friction_n) / valve.spring_rate_n_per_m


def _span_force_n(configuration: Configuration) -> float:
    guard = configuration.guard
    return configuration.valve.force_gain_n_per_ma * (guard.current_high_ma - guard.current_low_ma)


def example_text() -> str:
    """Return the commented example configuration."""
    return resources.files("positioner").joinpath("example.toml").read_text(encoding="utf-8")


def summary_rows(configuration: Configuration, state: Path) -> tuple[tuple[str, str], ...]:
    """Return the main properties of the configured valve: names, and values with units; `state` holds its table."""
    valve = configuration.valve
    friction_n = valve.static_friction_n
    return (
        ("valve", f"{valve.id}, span {valve.span_m * 1e3:g} mm"),
        ("restartable both ways", _range(*restartable_m(configuration), valve)),
        ("stiction", f"F_s {100 * friction_n / _span_force_n(configuration):.1f} % of the span force"),
        ("slip jump", f"{(friction_n - valve.coulomb_friction_n) / valve.spring_rate_n_per_m * 1e3:.2f} mm"),
        ("actuator", valve.actuator.in_words()),
        ("law", f"{configuration.control.law}, every {configuration.control.sample_period_s * 1e3:g} ms"),
        *([("shadow", f"{shadow}, which sends nothing")] if (shadow := configuration.control.shadow) else []),
        *_outside(configuration),
        *([("error to expect", expected)] if (expected := in_words(configuration)[0]) else []),
        *([("setpoint", configuration.setpoint.in_words())] if configuration.setpoint.shapes else []),
        ("actuator's deadman", _deadman(configuration)),
        ("bus", str(configuration.bus)),
        *([] if _is_too_much(configuration) else [("bus load", _load(configuration))]),
        *([("metrics", configuration.metrics.in_words())] if configuration.metrics.is_on else []),
        ("state", str(state)),
    )


def warnings(configuration: Configuration) -> tuple[str, ...]:
    """Return what is no mistake of the configuration, and yet will not go well, a line each."""
    guard, period_s = configuration.guard, configuration.control.sample_period_s
    error, why = in_words(configuration)
    lines = [f"error to expect: {error}: {why}"] if why else []
    low_m, high_m = restartable_m(configuration)
    if max(low_m, configuration.valve.travel_min_m) > min(high_m, configuration.valve.travel_max_m):
        lines.append("no current within the limits of [guard] frees the stem both ways, anywhere on its travel")
    longest_s = guard.actuator_deadman_s / guard.feedback_hold_periods
    if 0.0 < longest_s < period_s:
        lines.append(
            f"the sample period is too long for the actuator's deadman of {duration(guard.actuator_deadman_s)}: "
            f"beyond {duration(longest_s, 3)} the actuator goes to its fail position before HOLD, which comes after "
            f"{guard.feedback_hold_periods} periods without feedback, repeats a command"
        )
    lines += configuration.retired
    if _is_too_much(configuration):
        lines.append(f"bus load: {_load(configuration)}")
    return tuple(lines)


def _is_too_much(configuration: Configuration) -> bool:
    return bus_load.is_too_much(configuration.make_codec(), configuration.control.sample_period_s)


def _load(configuration: Configuration) -> str:
    return bus_load.in_words(configuration.make_codec(), configuration.control.sample_period_s)


def _outside(configuration: Configuration) -> list[tuple[str, str]]:
    """Return a row for each law that is a plug-in, whose code was not run; none for a law of this package."""
    laws = (configuration.control.law, configuration.control.shadow)
    text = "is a plug-in, from outside of this package, and was not loaded here; `run` loads it (SECURITY.md)"
    return [("law from outside", f"{law} {text}") for law in laws if law is not None and is_outside(law)]


def _shared_buses(configurations: Sequence[Configuration]) -> list[Finding]:
    """Return the finding on the load of each bus that several of the valves share."""
    return [
        bus_load.of_several(str(some[0].bus), [(each.make_codec(), each.control.sample_period_s) for each in some])
        for some in by_bus(configurations)
        if len(some) > 1
    ]


def _deadman(configuration: Configuration) -> str:
    deadman_s = configuration.guard.actuator_deadman_s
    return duration(deadman_s) if deadman_s else "none"


def _range(lowest_m: float, highest_m: float, valve: ValveParameters) -> str:
    """Return a range of positions in mm, cut off at the stops."""
    low_m, high_m = max(lowest_m, valve.travel_min_m), min(highest_m, valve.travel_max_m)
    if low_m > high_m:
        return "nowhere"
    stops = [stop for stop, ends in (("lower", low_m > lowest_m), ("upper", high_m < highest_m)) if ends]
    text = f"{low_m * 1e3:.1f} to {high_m * 1e3:.1f} mm"
    return f"{text} (to the {' and the '.join(stops)} stop)" if stops else text
