"""What the parts of the law `nmpc` on a valve with actuator lag are worth: its figures with each of them changed.

python -m benchmarks.actuator_lag
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

from tqdm import tqdm

from positioner.bench.metrics import totals
from positioner.bench.scenario import Scenario
from positioner.studies.direct import play_directly

if TYPE_CHECKING:
    from positioner.bench.metrics import Totals

LAGS_MS = (5.0, 20.0, 100.0)
SEEDS = (301, 302)
NOISES: dict[str, dict[str, float]] = {
    "0.05 % of span": {"noise_of_reading": 0.0, "noise_of_span": 0.0005},
    "2 % of reading": {"noise_of_reading": 0.02, "noise_of_span": 0.0},
}
VARIANTS: dict[str, dict[str, float]] = {
    "as it is": {},
    "no reserve for the brake": {"brake_reserve": 0.0},
    "slow ramps only": {"ramp_reach": 1e-3},
    "no landing bias": {"bias_gain": 0.0},
    "the lag is not learned": {"lag_doubt": 0.0},
}


def scenario(lag_ms: float, noise: dict[str, float], changes: dict[str, float], seed: int) -> Scenario:
    """Return eight setpoints of three seconds on the paper's valve with this lag, which the law knows."""
    lags = {"fill_time_constant_s": lag_ms * 1e-3, "vent_time_constant_s": lag_ms * 1e-3}
    control: dict[str, Any] = {"nmpc": {"lagged": changes}}
    return Scenario(
        name="lag",
        title="actuator lag",
        law="nmpc",
        seed=seed,
        setpoints_mm=(73.0, 87.0, 80.0, 73.0, 81.5, 83.0, 75.0, 77.0),
        dwell_s=3.0,
        plant={"preset": "paper", "actuator": lags, "sensor": noise},
        valve={"actuator": lags},
        control=control,
        estimator=noise,
    )


def cell(found: Totals) -> str:
    """Return mean and worst error in %, the median settling in ms, and the travel over the ideal one."""
    settling_ms = 1e3 * (found.median_settle_1pct_s or 0.0)
    errors = f"{found.mean_abs_error_pct:.3f} ({found.worst_mean_abs_error_pct:.2f})"
    return f"{errors}, {settling_ms:.0f} ms, {found.travel_ratio or 0.0:.2f}"


def main() -> None:
    """Play every variant, and print one table for each noise."""
    for title, noise in NOISES.items():
        rows = [f"{title}: mean (worst) error in %, settling, travel over ideal", ""]
        rows.append("| variant | " + " | ".join(f"{lag:g} ms" for lag in LAGS_MS) + " |")
        rows.append("|---" * (len(LAGS_MS) + 1) + "|")
        for variant in tqdm(VARIANTS, desc=title, file=sys.stderr):
            runs = [[scenario(lag, noise, VARIANTS[variant], seed) for seed in SEEDS] for lag in LAGS_MS]
            cells = [cell(totals([dwell for run in each for dwell in play_directly(run)])) for each in runs]
            rows.append(f"| {variant} | " + " | ".join(cells) + " |")
        sys.stdout.write("\n".join(rows) + "\n\n")


if __name__ == "__main__":
    main()
