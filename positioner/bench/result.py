"""The result of a bench run: `result.json` for programs, a table for people.

Two runs in lockstep with the same seed write the same bytes, except for the object `run`: it holds all that depends on
the machine, the bus or the time of day.
"""

from __future__ import annotations

import json
import platform
from dataclasses import asdict, dataclass
from enum import Enum
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import positioner
from positioner.bench.modes import active_fraction, mode_lines
from positioner.bench.timing import timing_lines
from positioner.report.table import Table
from positioner.valve.stiction import Quantity

if TYPE_CHECKING:
    from collections.abc import Sequence

    from positioner.bench.metrics import DwellMetrics, Totals
    from positioner.bench.modes import ModeSpan
    from positioner.bench.scenario import Scenario
    from positioner.bench.timing import Timing
    from positioner.report.text import Block
    from positioner.valve.stiction import StictionTable

SIGNIFICANT_DIGITS = 6
"""Digits of every figure in `result.json`: far more than is meaningful, far fewer than double precision has."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TableSummary:
    """How much a stiction table holds: cells, samples ever recorded, and samples kept of each quantity."""

    cells: int
    recorded: int
    stick_speeds: int
    breakaway_currents: int
    landing_biases: int


@dataclass(frozen=True, slots=True, kw_only=True)
class RunInfo:
    """All that may differ between two runs of the same scenario and seed."""

    bus: str
    """Interface and channel."""
    clock: str
    """`lockstep` or `real-time`."""
    started_at: str
    """ISO 8601, UTC."""
    wall_s: float
    machine: str
    versions: dict[str, str]
    timing: Timing | None = None
    """How it kept time, in real time."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """The result of a run."""

    scenario: Scenario
    span_mm: float
    """Length of 100 %."""
    modes: tuple[ModeSpan, ...]
    """The positioner's modes from beginning to end; only in ACTIVE the law is in control."""
    totals: Totals
    dwells: tuple[DwellMetrics, ...]
    table_before: TableSummary
    table_after: TableSummary
    run: RunInfo
    notes: tuple[str, ...] = ()
    """What is to be said of the length of the dwells."""


def summary_of(table: StictionTable) -> TableSummary:
    """Return how much `table` holds."""
    kept = dict.fromkeys(Quantity, 0)
    for key, cell in table:
        kept[key.quantity] += len(cell.samples)
    return TableSummary(
        cells=len(table),
        recorded=table.sequence,
        stick_speeds=kept[Quantity.STICK_SPEED],
        breakaway_currents=kept[Quantity.BREAKAWAY_CURRENT],
        landing_biases=kept[Quantity.LANDING_BIAS],
    )


def installed_versions() -> dict[str, str]:
    """Return the versions of the project, of Python and of the packages that compute or carry the run."""
    packages = {name.replace("-", "_"): version(name) for name in ("numpy", "osqp", "cantools", "python-can")}
    return {"positioner": positioner.__version__, "python": platform.python_version(), **packages}


def to_json(result: Result) -> str:
    """Return `result` as JSON text: keys in the order of the dataclasses, figures at `SIGNIFICANT_DIGITS`."""
    # the scenario is input and no figure: it is not rounded
    values = {key: value if key == "scenario" else _rounded(value) for key, value in asdict(result).items()}
    values["active_fraction"] = _rounded(active_fraction(result.modes))
    return json.dumps(values, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def blocks(result: Result) -> list[Block]:
    """Return `result` as text with a table.

    Its last row sums up each column: mean, largest value, median of the settling times, count or sum.
    """
    scenario, run, totals = result.scenario, result.run, result.totals
    before, after = result.table_before, result.table_after
    settled_1pct, settled_2pct = totals.dwells - totals.unsettled_1pct, totals.dwells - totals.unsettled_2pct
    period_ms = scenario.sample_period_s * 1e3
    rows = [_row(str(number), dwell) for number, dwell in enumerate(result.dwells, start=1)]
    return [
        f"{scenario.name}: {scenario.title}",
        f"law {scenario.law}, seed {scenario.seed}, period {period_ms:g} ms, {run.clock} on {run.bus}",
        "",
        Table(_HEAD, (*rows, _foot(totals)), marked=frozenset({len(rows)})),
        "",
        *_labelled("modes", mode_lines(result.modes)),
        *_labelled("time", () if run.timing is None else timing_lines(run.timing, scenario.sample_period_s)),
        f"error    {totals.worst_mean_abs_error_pct:.2f} % of the {result.span_mm:g} mm span in the worst dwell",
        f"settled  {settled_1pct} to 1 %, {settled_2pct} to 2 %, of {totals.dwells}",
        *_labelled("dwell", result.notes),
        f"cycling  {totals.limit_cycles}",
        f"travel   {_or_dash(totals.travel_ratio)} times the shortest way",
        f"table    {before.recorded} → {after.recorded} samples, {before.cells} → {after.cells} cells",
        f"took     {run.wall_s:.1f} s for {scenario.duration_s:g} s of the plant's time",
    ]


def _labelled(label: str, lines: Sequence[str]) -> list[str]:
    """Return the lines in a column, the first one beside its label."""
    return [f"{label if number == 0 else '':9}{line}" for number, line in enumerate(lines)]


_HEAD = (
    *("", "setpoint, mm", "mean |e|, %", "max |e|, %", "to 1 %, ms", "to 2 %, ms", "overshoot, %"),
    *("reversals", "cycle", "travel, mm", "IAE, mm·s", "Σ|Δu|, mA"),
)


def _row(label: str, dwell: DwellMetrics) -> tuple[str, ...]:
    labels = (label, f"{dwell.setpoint_mm:.1f}")
    return _cells(labels, dwell, (dwell.settle_1pct_s, dwell.settle_2pct_s), "yes" if dwell.limit_cycle else "no")


def _foot(total: Totals) -> tuple[str, ...]:
    medians_s = (total.median_settle_1pct_s, total.median_settle_2pct_s)
    return _cells(("all", ""), total, medians_s, str(total.limit_cycles))


def _cells(
    labels: tuple[str, str], figures: DwellMetrics | Totals, settled_s: tuple[float | None, float | None], cycle: str
) -> tuple[str, ...]:
    return (
        *labels,
        f"{figures.mean_abs_error_pct:.2f}",
        f"{figures.max_abs_error_pct:.2f}",
        *(_milliseconds(time_s) for time_s in settled_s),
        f"{figures.overshoot_pct:.2f}",
        str(figures.reversals),
        cycle,
        f"{figures.travel_mm:.2f}",
        f"{figures.iae_mm_s:.2f}",
        f"{figures.command_variation_ma:.1f}",
    )


def _milliseconds(duration_s: float | None) -> str:
    return "never" if duration_s is None else f"{duration_s * 1e3:.1f}"


def _or_dash(ratio: float | None) -> str:
    return "–" if ratio is None else f"{ratio:.2f}"


def _rounded(value: Any) -> Any:
    if isinstance(value, Enum):
        return value.name
    if isinstance(value, float):
        return float(f"{value:.{SIGNIFICANT_DIGITS}g}") + 0.0  # + 0.0 makes a zero of either sign the same text
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_rounded(item) for item in value]
    return value
