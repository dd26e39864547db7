"""What the law `nmpc` on a valve with actuator lag keeps over a restart is worth: the first dwells after it.

python -m benchmarks.restart

Eight dwells teach a table. Then the law starts again, with nothing, with the table's cells alone, and with the kept K,
F_s, F_c and lag, too. A cell has the mean error in the last half second of the first two dwells, the median settling,
and the moves for each dwell.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from tqdm import tqdm

from positioner.bench.inprocess import configure, run_in_process
from positioner.bench.metrics import dwell_metrics, totals
from positioner.bench.scenario import Scenario
from positioner.cycle.events import MoveBegan

if TYPE_CHECKING:
    from positioner.bench.metrics import DwellMetrics
    from positioner.valve.stiction import StictionTable

LAGS_MS = (10.0, 100.0)
SEEDS = (321, 322, 323)
NOISES: dict[str, dict[str, float]] = {
    "0.05 % of span": {"noise_of_reading": 0.0, "noise_of_span": 0.0005},
    "2 % of reading": {"noise_of_reading": 0.02, "noise_of_span": 0.0},
}
TRUE: dict[str, tuple[dict[str, float], float]] = {
    "as configured": ({}, 1.0),
    "spring -10 %, friction +15 %": ({"spring_rate_n_per_m": 47284.0, "static_friction_n": 1964.0}, 1.0),
    "the same, and lag +30 %": ({"spring_rate_n_per_m": 47284.0, "static_friction_n": 1964.0}, 1.3),
}
TAUGHT_MM = (73.0, 87.0, 80.0, 73.0, 81.5, 83.0, 75.0, 77.0)
JUDGED_MM = (85.0, 72.0)
DWELL_S = 3.0


def scenario(true: str, lag_ms: float, noise: dict[str, float], seed: int, *, judged: bool) -> Scenario:
    """Return the dwells that teach, or those that are judged."""
    valve, factor = TRUE[true]
    own, told = ({f"{name}_time_constant_s": by * lag_ms * 1e-3 for name in ("fill", "vent")} for by in (factor, 1.0))
    plant: dict[str, Any] = {"preset": "paper", "valve": dict(valve), "actuator": own, "sensor": noise}
    plant["valve"]["initial_position_m"] = 0.078
    if "static_friction_n" in valve:
        plant["valve"]["coulomb_friction_n"] = 1.15 * 1423.0
    return Scenario(
        name="restart",
        title="restart",
        law="nmpc",
        seed=seed + 1000 * judged,
        setpoints_mm=JUDGED_MM if judged else TAUGHT_MM,
        dwell_s=DWELL_S,
        plant=plant,
        valve={"actuator": told},
        estimator=noise,
    )


def played(own: Scenario, table: StictionTable | None) -> tuple[list[DwellMetrics], float]:
    """Return the figures of the dwells, and the moves for each."""
    run = run_in_process(own, table)
    moves = sum(isinstance(event, MoveBegan) for event in run.events) / len(own.setpoints_mm)
    return list(dwell_metrics(run.recording.trace, own.dwell_edges_s, configure(own).valve.span_m)), moves


def main() -> None:
    """Print one table for each noise."""
    for title, noise in NOISES.items():
        rows = [f"{title}: error in % (worst), settling, moves", ""]
        kinds = ("nothing kept", "cells alone", "cells and fit")
        rows.append("| true valve | lag | " + " | ".join(kinds) + " |")
        rows.append("|---" * (len(kinds) + 2) + "|")
        for true in tqdm(TRUE, desc=title, file=sys.stderr):
            for lag_ms in LAGS_MS:
                found: dict[str, list[tuple[list[DwellMetrics], float]]] = {kind: [] for kind in kinds}
                for seed in SEEDS:
                    table = run_in_process(scenario(true, lag_ms, noise, seed, judged=False)).table
                    judged = scenario(true, lag_ms, noise, seed, judged=True)
                    for kind, kept in zip(kinds, (None, replace(table, fit=None), table), strict=True):
                        found[kind].append(played(judged, kept))
                rows.append(f"| {true} | {lag_ms:g} ms | " + " | ".join(_cell(found[kind]) for kind in kinds) + " |")
        sys.stdout.write("\n".join(rows) + "\n\n")
        sys.stdout.flush()


def _cell(runs: list[tuple[list[DwellMetrics], float]]) -> str:
    all_dwells = totals([dwell for dwells, _ in runs for dwell in dwells])
    moves = sum(moves for _, moves in runs) / len(runs)
    settling_ms = 1e3 * (all_dwells.median_settle_1pct_s or 0.0)
    error = f"{all_dwells.mean_abs_error_pct:.3f} ({all_dwells.worst_mean_abs_error_pct:.2f})"
    return f"{error}, {settling_ms:.0f} ms, {moves:.1f}"


if __name__ == "__main__":
    main()
