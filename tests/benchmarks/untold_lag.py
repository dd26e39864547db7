"""The law `nmpc` where nobody has told it how the actuator lags: when it finds that out, and whether it ever errs.

python -m benchmarks.untold_lag [--seeds A,B] [--dwell S] [--dwells N] [--false-alarms]

The first table has valves with a lag: the moves until it was found, the lag that was found, and the error in the dwells
after. With `--false-alarms` the second one has valves without lag, under all conditions of `other_valves` at 1 kHz and
slower, with the sensor told to be noisy and to be precise: the dwells, and in how many runs a lag was found.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from statistics import fmean

from tqdm import tqdm

from benchmarks.other_valves import CONDITIONS, SHORT, Condition, Noise, play

LAGS_MS = (0.5, 1.0, 2.0, 5.0, 20.0, 100.0, 300.0)
_PRECISE = 0.0005
_MIDDLE_M, _SPAN_M = 0.08, 0.127
"""Where a precise sensor has its σ: the noise of these runs is a part of the reading."""


def precise(condition: Condition) -> Condition:
    """Return the condition with a sensor of 0.05 % of span, which the law is told."""
    noise = condition.noise
    if noise.of_reading:
        noise = replace(noise, of_reading=_PRECISE * _SPAN_M / _MIDDLE_M)
    return replace(condition, noise=noise, told_of_span=_PRECISE)


def lag_row(condition: Condition, seeds: tuple[int, ...], dwells: int, dwell_s: float) -> str:
    """Return when the lag was found, which, and the error before the dwell in which it was found and after it."""
    moves_until, found_ms, after = list[int](), list[float](), list[float]()
    for seed in seeds:
        moves, is_found = 0, False
        for figures, moved, actuator in play(condition, seed, dwells, dwell_s, uses_table=True):
            if is_found:
                after.append(figures.mean_abs_error_pct)
            moves += 0 if is_found else moved
            if actuator is not None and not is_found:
                is_found = True
                moves_until.append(moves)
                found_ms.append(1e3 * (actuator.fill_time_constant_s + actuator.dead_time_s))
    lags = ", ".join(f"{each:.3g}" for each in found_ms)
    if not after:
        return f"{condition.name:32} {len(moves_until)} of {len(seeds)}"
    figures_after = f"{fmean(after):.3f} {max(after):.2f}"
    return f"{condition.name:32} {len(moves_until)} of {len(seeds)}  {fmean(moves_until):5.1f}  {figures_after}  {lags}"


def false_row(condition: Condition, seeds: tuple[int, ...], dwells: int, dwell_s: float) -> str:
    """Return in how many runs a lag was found that is not there."""
    alarms = 0
    for seed in seeds:
        *_, (_, _, actuator) = play(condition, seed, dwells, dwell_s, uses_table=True)
        alarms += actuator is not None
    return f"{condition.name:32} {dwells * len(seeds):5d} dwells  {alarms} of {len(seeds)} runs"


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.untold_lag", description=__doc__)
    parser.add_argument("--seeds", default="1,2,3")
    parser.add_argument("--dwell", type=float, default=1.5)
    parser.add_argument("--dwells", type=int, default=12)
    parser.add_argument("--false-alarms", action="store_true")
    given = parser.parse_args()
    seeds = tuple(int(seed) for seed in given.seeds.split(","))
    if given.false_alarms:
        noisy = [each for each in CONDITIONS if each.name in SHORT]
        rows = [*noisy, *(replace(precise(each), name=f"{each.name}, precise") for each in noisy)]
        make = false_row
    else:
        noisy = [Condition(f"{lag:g} ms, 2 %", noise=Noise(), lag_s=lag / 1e3) for lag in LAGS_MS]
        rows = [*(replace(precise(each), name=each.name.replace("2 %", "0.05 %")) for each in noisy), *noisy]
        make = lag_row
        sys.stdout.write(
            "condition                        found    moves until  mean % after, worst, lags found in ms\n"
        )
    for condition in tqdm(rows, leave=False, disable=None):
        sys.stdout.write(make(condition, seeds, given.dwells, given.dwell) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
