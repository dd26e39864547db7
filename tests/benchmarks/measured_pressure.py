"""What a measured pressure is worth to the law `nmpc` on a valve with actuator lag: conditions of the league, with it.

python -m benchmarks.measured_pressure [--seeds A,B] [--dwell S] [--noises 0.05,2]

A cell has the mean error in % (the worst dwell), the median settling to 1 %, and the travel over the ideal one.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace

from tqdm import tqdm

from positioner.bench.metrics import totals
from positioner.inputs.toml_reader import laid_over
from positioner.studies.direct import play_directly
from positioner.studies.real_valves.bouts import RealBout
from positioner.studies.real_valves.conditions import AS_TOLD, CONDITIONS
from positioner.studies.real_valves.valves import NOISE_NAMES

NAMES = (
    AS_TOLD,
    "untold-lag+30",
    "untold-lag-30",
    "untold-vent-0.6",
    "untold-dead-time-1",
    "supply-17",
    "growing-friction",
)
LAGS_S = (0.01, 0.1)
SENSORS: dict[str, dict[str, float]] = {
    "not measured": {},
    "σ 0.5 % of reading": {"reports_pressure": True, "pressure_noise": 0.005},
    "σ 2 % of reading": {"reports_pressure": True, "pressure_noise": 0.02},
}


def cell(name: str, lag_s: float, noise: str, seeds: list[int], dwell_s: float, sensor: dict[str, float]) -> str:
    """Return the figures of one condition with one pressure sensor."""
    dwells = []
    for seed in seeds:
        bout = RealBout(
            law="nmpc",
            plant="paper",
            lag_s=lag_s,
            noise=noise,
            seed=seed,
            condition=name,
            setpoints=8,
            dwell_s=dwell_s,
            period_s=0.001,
        )
        own = bout.scenario
        dwells += list(play_directly(replace(own, plant=laid_over(own.plant, {"sensor": sensor}))))
    found = totals(dwells)
    settling_ms = 1e3 * (found.median_settle_1pct_s or 0.0)
    errors = f"{found.mean_abs_error_pct:.3f} ({found.worst_mean_abs_error_pct:.2f})"
    return f"{errors}, {settling_ms:.0f} ms, {found.travel_ratio or 0.0:.2f}"


def main() -> None:
    """Print one table for each noise of the position."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="311,312,313")
    parser.add_argument("--dwell", type=float, default=3.0)
    parser.add_argument("--noises", default="0.05,2")
    given = parser.parse_args()
    seeds = [int(seed) for seed in given.seeds.split(",")]
    for noise in given.noises.split(","):
        rows = ["| condition | lag | " + " | ".join(SENSORS) + " |", "|---" * (2 + len(SENSORS)) + "|"]
        for name in tqdm(NAMES, desc=NOISE_NAMES[noise], file=sys.stderr):
            text = CONDITIONS[name].text if name in CONDITIONS else name
            for lag_s in LAGS_S:
                cells = [cell(name, lag_s, noise, seeds, given.dwell, sensor) for sensor in SENSORS.values()]
                rows.append(f"| {text} | {lag_s * 1e3:g} ms | " + " | ".join(cells) + " |")
        sys.stdout.write(f"{NOISE_NAMES[noise]}\n\n" + "\n".join(rows) + "\n\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
