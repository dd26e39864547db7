"""The paper's five simulations in every interpretation of the paper, in process, on all cores. Shell."""

from __future__ import annotations

from contextlib import closing
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from tqdm import tqdm

from positioner.bench import metrics
from positioner.bench.inprocess import configure, run_in_process
from positioner.bench.scenario import load_scenario
from positioner.pictures.curves import envelope
from positioner.studies.interpretations import Interpretation, Units, interpreted_as
from positioner.studies.pool import EVERY_CORE, spread_out

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from positioner.bench.inprocess import InProcessRun
    from positioner.bench.scenario import Scenario
    from positioner.studies.pool import Workers

SIMULATIONS = (1, 2, 3, 4, 5)
WITH_TABLE = (3, 4, 5)
"""Simulations that use the stiction table, and thus α and β."""

SHORT_DWELL_S = 0.015
"""Dwell of a short run instead of 1 s: enough for every move, too short for the stem at rest."""

VISIBLE_M = 127e-6
"""Motion back from a turning point that counts as a reversal here: 0.1 % of span, which is visible in a figure of the
paper. Noise alone moves the stem by micrometres."""

_CURVE_POINTS = 6000


@dataclass(frozen=True, slots=True)
class Run:
    """One simulation in one interpretation."""

    simulation: int
    interpretation: Interpretation
    short: bool = False

    @property
    def scenario(self) -> Scenario:
        """The packaged scenario, changed for this interpretation."""
        scenario = interpreted_as(
            load_scenario(f"paper-{self.simulation}"), self.interpretation.noise, self.interpretation.units
        )
        if not self.short:
            return scenario
        shrink = SHORT_DWELL_S / scenario.dwell_s
        from_s = None if scenario.table_from_s is None else scenario.table_from_s * shrink
        return replace(scenario, dwell_s=SHORT_DWELL_S, table_from_s=from_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class Half:
    """Figures of half a run, which has three dwells.

    `positioner.bench.metrics` defines the figures that are not defined here. Error, range, current and speed are
    taken over the second half of each dwell.

    error_pct, range_pct: mean |error| and peak-to-peak motion in percent of span, mean over the dwells.
    current_range_ma: peak-to-peak current, mean over the dwells.
    speed_m_per_s: root mean square over the dwells.
    reversals: those above `VISIBLE_M`, including those of the moves.
    """

    dwells: int
    error_pct: float
    range_pct: float
    overshoot_pct: float
    reversals: int
    limit_cycles: int
    current_range_ma: float
    speed_m_per_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Curves:
    """The curves of the picture, reduced to their envelopes; shape (points,). A bound is NaN where it is not active."""

    time_s: NDArray[np.float64]
    setpoint_m: NDArray[np.float64]
    position_m: NDArray[np.float64]
    current_ma: NDArray[np.float64]
    current_low_ma: NDArray[np.float64]
    current_high_ma: NDArray[np.float64]
    velocity_m_per_s: NDArray[np.float64]
    speed_low_m_per_s: NDArray[np.float64]
    speed_high_m_per_s: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class PlayedRun:
    """A run that was played: its figures before and after half time, when use of the table begins, and its curves."""

    run: Run
    before: Half
    after: Half
    curves: Curves


def all_runs(interpretations: Sequence[Interpretation], *, short: bool) -> tuple[Run, ...]:
    """Return every run. Without a table α and β have no effect: simulations 1 and 2 are played in SI only."""
    return tuple(
        Run(simulation, interpretation, short)
        for simulation in SIMULATIONS
        for interpretation in interpretations
        if simulation in WITH_TABLE or interpretation.units is Units.SI
    )


def reproduce(runs: Sequence[Run], workers: Workers = EVERY_CORE) -> tuple[PlayedRun, ...]:
    """Return the played runs in the order of `runs`; a progress bar shows how many are done."""
    found: dict[Run, PlayedRun] = {}
    with (
        tqdm(total=len(runs), unit=" runs", disable=None) as bar,
        closing(spread_out(play, runs, workers)) as results,
    ):
        for run, played in results:
            found[run] = played
            bar.set_postfix_str(f"simulation {run.simulation}, interpretation {run.interpretation}")
            bar.update()
    return tuple(found[run] for run in runs)


def play(run: Run) -> PlayedRun:
    """Return the figures and curves of one run."""
    scenario = run.scenario
    span_m = configure(scenario).valve.span_m
    played = run_in_process(scenario)
    trace, velocity_m_per_s = played.recording.trace, played.recording.true_velocity_m_per_s
    dwells = range(len(scenario.visited_mm))
    before, after = dwells[: len(dwells) // 2], dwells[len(dwells) // 2 :]
    return PlayedRun(
        run,
        half_figures(trace, velocity_m_per_s, scenario, span_m, before),
        half_figures(trace, velocity_m_per_s, scenario, span_m, after),
        _curves(scenario, played),
    )


def half_figures(
    trace: metrics.Trace, velocity_m_per_s: NDArray[np.float64], scenario: Scenario, span_m: float, dwells: range
) -> Half:
    """Return the figures of these dwells of a run; `velocity_m_per_s` has the shape of the trace."""
    per_dwell = scenario.samples_per_dwell
    part = slice(dwells.start * per_dwell, dwells.stop * per_dwell)
    ends = [slice(dwell * per_dwell + per_dwell // 2, (dwell + 1) * per_dwell) for dwell in dwells]
    figures = metrics.dwell_metrics(trace, scenario.dwell_edges_s, span_m)[dwells.start : dwells.stop]
    return Half(
        dwells=len(dwells),
        error_pct=float(np.mean([dwell.mean_abs_error_pct for dwell in figures])),
        range_pct=float(np.mean([np.ptp(trace.position_m[end]) for end in ends])) * 100.0 / span_m,
        overshoot_pct=max(dwell.overshoot_pct for dwell in figures),
        reversals=metrics.count_reversals(trace.position_m[part], VISIBLE_M),
        limit_cycles=sum(dwell.limit_cycle for dwell in figures),
        current_range_ma=float(np.mean([np.ptp(trace.current_ma[end]) for end in ends])),
        speed_m_per_s=float(np.sqrt(np.mean([np.mean(velocity_m_per_s[end] ** 2) for end in ends]))),
    )


def _curves(scenario: Scenario, played: InProcessRun) -> Curves:
    recording, configuration = played.recording, configure(scenario)
    fastest_m_per_s = configuration.control.bounds.max_speed_m_per_s
    free = {
        "current_low_ma": configuration.guard.current_low_ma,
        "current_high_ma": configuration.guard.current_high_ma,
        "speed_low_m_per_s": -fastest_m_per_s,
        "speed_high_m_per_s": fastest_m_per_s,
    }
    columns = {
        "setpoint_m": recording.setpoint_m,
        "position_m": recording.true_position_m,
        "current_ma": recording.current_ma,
        "velocity_m_per_s": recording.true_velocity_m_per_s,
    }
    # a cycle's time is that of its end: one period after its sample
    samples = [round(cycle.time_s / recording.period_s) - 1 for cycle in played.cycles]
    for name, free_value in free.items():
        bound = np.full(recording.samples, np.nan)
        bound[samples] = [getattr(cycle.decision.bounds, name) for cycle in played.cycles]
        bound[bound == free_value] = np.nan
        columns[name] = bound
    time_s, _ = envelope(recording.time_s, recording.setpoint_m, _CURVE_POINTS)
    return Curves(
        time_s=time_s,
        **{name: envelope(recording.time_s, values, _CURVE_POINTS)[1] for name, values in columns.items()},
    )
