"""A bench on a bus: emulator and daemon as processes, and the files of the run. Shell."""

from __future__ import annotations

import contextlib
import os
import shutil
import time
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import tomli_w

from plant_emulator.presets import DEFAULT_PRESET
from positioner.bench import metrics
from positioner.bench.commission import commission
from positioner.bench.configure import configuration_text
from positioner.bench.dwell_length import dwell_notes
from positioner.bench.machine_load import machine
from positioner.bench.modes import mode_spans
from positioner.bench.moves_picture import draw_moves
from positioner.bench.play import BenchOptions, play
from positioner.bench.playable import check_playable
from positioner.bench.result import Result, RunInfo, installed_versions, summary_of, to_json
from positioner.bench.trace_data import picture_data
from positioner.bench.trend import draw_trend
from positioner.bench.truth_log import add_truth
from positioner.bus.address import BusAddress, embedded_address, find_vcan
from positioner.config.reader import parse_config
from positioner.errors import BenchError, StateError, writing
from positioner.inputs.plug_in import anchored
from positioner.laws.registry import is_outside
from positioner.store import access, lock
from positioner.valve.stiction import StictionTable

if TYPE_CHECKING:
    from collections.abc import Callable

    from positioner.bench.scenario import Scenario
    from positioner.config.schema import Configuration

_COMMAND_DELAY_PERIODS = 0.8
"""When commands act after a reading in real time: most of the period is for the cycle, the rest for the emulator."""


ON_VCAN = "a virtual CAN interface of this machine"


def choose_bus(address: BusAddress | None) -> tuple[BusAddress, str]:
    """Return the bus to use, and a line that gives the reason."""
    if address is not None:
        return address, f"bus {address}"
    vcan = find_vcan()
    if vcan is not None:
        return vcan, f"bus {vcan}: {ON_VCAN}"
    embedded = embedded_address(os.getpid())
    advice = "for a vcan: sudo modprobe vcan && sudo ip link add dev vcan0 type vcan && sudo ip link set vcan0 up"
    return embedded, f"bus {embedded}: embedded, never leaves this machine ({advice})"


def run_bench(scenario: Scenario, options: BenchOptions, say: Callable[[str], object]) -> Result:
    """Play `scenario`, and write `result.json`, `bus.log` and the pictures into the output directory.

    `say` receives each line of progress.

    Raises:
        AlreadyRunningError: another bench writes into the output directory.
        ConfigurationError: the scenario's tables do not make a valve or a positioner.
        BenchError: a process failed, frames were lost, or the disk is full.
        StateError: the table cannot be used, or the output directory cannot be made.
    """
    with writing(options.out):
        options.out.mkdir(parents=True, exist_ok=True)
    try:
        with lock.held(options.out, timeout_s=0.0):
            return _run(scenario, options, say)
    except OSError as error:
        raise BenchError(f"{error.filename or options.out}: {error.strerror}") from error


def _in_real_time(scenario: Scenario) -> Scenario:
    """Return `scenario` with the instant at which commands act, where it does not give one: late in the period.

    A command that comes later acts a period later, which the law cannot know before.
    """
    delay_s = _COMMAND_DELAY_PERIODS * scenario.sample_period_s
    return replace(scenario, control={"command_delay_s": delay_s, **scenario.control})


def _run(scenario: Scenario, options: BenchOptions, say: Callable[[str], object]) -> Result:
    if not options.lockstep:
        scenario = _in_real_time(scenario)
    address, reason = choose_bus(options.bus)
    say(reason)
    out = options.out
    state = options.state or out / "state"
    configuration = _write_configuration(scenario, options, address, state)
    plant = check_playable(scenario, configuration)
    if is_outside(scenario.law):
        configuration.make_law(plays=True)  # one that cannot be made is told here, and not in the log of the daemon
    if options.state is None:
        _empty(state, say)
    if scenario.commission:
        commission(scenario, options, configuration, say)
        configuration = parse_config((out / "valve.toml").read_text(encoding="utf-8"), str(out / "valve.toml"), out)
    started, begun_s = datetime.now(UTC), time.monotonic()
    initial = _stored(state, configuration)
    _copy_start(state, out / "state-before")
    recording, timing = play(scenario, options, configuration, state)
    after = summary_of(_stored(state, configuration))

    span_m = configuration.valve.span_m
    dwells = metrics.dwell_metrics(recording.trace, scenario.dwell_edges_s, span_m)
    result = Result(
        scenario=scenario,
        span_mm=span_m * 1e3,
        # silent after the actuator's deadman time, but not before three periods
        modes=mode_spans(
            recording.mode_reports, scenario.duration_s, max(plant.deadman_s, 3.0 * scenario.sample_period_s)
        ),
        totals=metrics.totals(dwells),
        dwells=dwells,
        table_before=summary_of(initial),
        table_after=after,
        run=RunInfo(
            bus=str(address),
            clock="lockstep" if options.lockstep else "real-time",
            started_at=started.isoformat(timespec="seconds"),
            wall_s=time.monotonic() - begun_s,
            machine=machine(),
            versions=installed_versions(),
            timing=timing,
        ),
        notes=dwell_notes(scenario, configuration, dwells),
    )
    (out / "result.json").write_text(to_json(result), encoding="utf-8")
    if options.lockstep:
        recording.write_log(out / "bus.log")
    else:
        add_truth(out / "bus.log", recording)
    trend, moves = picture_data(result, recording, out / "trace.csv", configuration, initial)
    draw_trend(out / "trend.png", trend)
    draw_moves(out / "moves.png", moves)
    return result


def _empty(directory: Path, say: Callable[[str], object]) -> None:
    """Empty the table in the run's own state directory; the table of an earlier run is backed up."""
    if directory.exists():
        backup = access.reset(directory)
        if backup:
            say(f"the table of the last run is now in {backup}; --state {directory} would have started from it")


def _write_configuration(scenario: Scenario, options: BenchOptions, address: BusAddress, state: Path) -> Configuration:
    path = options.out / "valve.toml"
    scenario = replace(scenario, law=anchored(scenario.law, Path.cwd()))
    # a relative path: the run's own table moves with the folder
    text = configuration_text(scenario, address, state.absolute() if options.state else Path("state"))
    path.write_text(text, encoding="utf-8")
    (options.out / "plant.toml").write_text(
        tomli_w.dumps({"preset": DEFAULT_PRESET, **scenario.plant}), encoding="utf-8"
    )
    return parse_config(text, str(path), options.out)


def _stored(state: Path, configuration: Configuration) -> StictionTable:
    try:
        return access.dump(state).table
    except StateError:
        return StictionTable(cell_width_m=configuration.control.table_cell_m)


def _copy_start(state: Path, place: Path) -> None:
    """Copy the table that the run starts from, if there is one: a replay needs it."""
    shutil.rmtree(place, ignore_errors=True)
    with contextlib.suppress(StateError):
        stored = access.dump(state)
        place.mkdir()
        access.replace(place, stored, force=True)
