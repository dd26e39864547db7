"""`plant-emulator simulate`: a current waveform in, the valve's motion out, as CSV. Shell."""

from __future__ import annotations

import csv
import math
import sys
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

from tqdm import tqdm

from plant_emulator import valve
from plant_emulator.cli.plant_options import SECONDS, add_plant_options, plant_of
from plant_emulator.cli.waveforms import HIGHEST_CURRENT_MA, Shape, Waveform, from_file, shaped
from positioner.errors import ExitCode, PositionerError
from positioner.inputs.nearest import check_name
from positioner.inputs.numbers import number, whole

if TYPE_CHECKING:
    import argparse
    from collections.abc import Iterator
    from contextlib import AbstractContextManager
    from typing import TextIO

    from plant_emulator.parameters import PlantSettings

_HEADER = ("time_s", "current_ma", "pressure_pa", "position_m", "velocity_m_per_s", "friction_n")
_PROGRESS_AFTER_S = 2.0
_DEFAULT_DURATION_S = 60.0
_CURRENT = number(0.0, HIGHEST_CURRENT_MA, f"mA from 0 to {HIGHEST_CURRENT_MA:g}")


class OutputError(PositionerError):
    """The result cannot be written."""

    exit_code = ExitCode.IO


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    parser = subparsers.add_parser(
        "simulate",
        help="drive a valve with a current waveform, and write its motion as CSV",
        description="Drive a valve with a current waveform and write its motion as CSV, one row per period. "
        "current_ma is the current during the period that ends at time_s. The first row is the start: the stem is held "
        "at its initial position, under the first current of the waveform.",
        epilog="example: plant-emulator simulate --preset paper --set valve.mass_kg=2 --input step --duration 1 "
        "--low-ma 8 --high-ma 14 --out step.csv",
    )
    add_plant_options(parser)
    parser.add_argument(
        "--input", default="triangle", metavar="ramp|step|triangle|FILE.csv",
        help="waveform, or a file with the columns time_s,current_ma (default: triangle)",
    )  # fmt: skip
    parser.add_argument("--out", default="-", metavar="FILE.csv", help="where to write (default: standard output)")
    parser.add_argument(
        "--duration", type=SECONDS, metavar="S",
        help=f"simulated time (default: {_DEFAULT_DURATION_S:g} s, or all of FILE.csv)",
    )  # fmt: skip
    parser.add_argument("--period", type=SECONDS, default=0.001, metavar="S", help="time per row (default: 0.001 s)")
    parser.add_argument("--seed", type=whole, default=0, metavar="N", help="seed of stochastic friction (default: 0)")
    parser.add_argument("--low-ma", type=_CURRENT, default=4.0, metavar="MA", help="lowest current (default: 4 mA)")
    parser.add_argument("--high-ma", type=_CURRENT, default=20.0, metavar="MA", help="highest current (default: 20 mA)")
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> ExitCode:
    settings = plant_of(options)
    waveform = _waveform(options)
    try:
        with _opened(options.out) as file:
            writer = csv.writer(file)
            writer.writerow(_HEADER)
            writer.writerows(_rows(settings, waveform, options))
    except BrokenPipeError:
        raise
    except OSError as error:
        raise OutputError(f"{options.out}: cannot be written: {error.strerror}") from error
    return ExitCode.OK


def _rows(settings: PlantSettings, waveform: Waveform, options: argparse.Namespace) -> Iterator[tuple[float, ...]]:
    duration_s = options.duration or waveform.duration_s
    begin_ma = waveform.current_ma(0.0)
    state = valve.held_state(settings, options.seed, begin_ma)
    yield _row(settings, state, begin_ma)
    steps = math.ceil(duration_s / options.period - 1e-9)
    for index in tqdm(range(steps), unit="step", delay=_PROGRESS_AFTER_S, leave=False, disable=None):
        current_ma = waveform.current_ma(index * options.period)
        state = valve.step(settings, state, current_ma, options.period)
        yield _row(settings, state, current_ma)


def _row(settings: PlantSettings, state: valve.PlantState, current_ma: float) -> tuple[float, ...]:
    return (
        round(state.time_s, 9),
        current_ma,
        state.actuator.pressure_pa,
        state.stem.position_m,
        state.stem.velocity_m_per_s,
        valve.friction_n(settings, state),
    )


def _waveform(options: argparse.Namespace) -> Waveform:
    if options.input in tuple(Shape):
        duration_s = options.duration or _DEFAULT_DURATION_S
        return shaped(Shape(options.input), options.low_ma, options.high_ma, duration_s)
    file = Path(options.input)
    if not file.suffix and file.name == options.input and not file.exists():
        check_name("waveform", options.input, tuple(Shape), "or give the path of a .csv file")
    return from_file(file)


def _opened(out: str) -> AbstractContextManager[TextIO]:
    return nullcontext(sys.stdout) if out == "-" else Path(out).open("w", newline="", encoding="utf-8")
