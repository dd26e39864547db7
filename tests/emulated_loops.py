"""Control loops with an emulated valve, for the diagnoses: PI, process, noise, and whatever disturbs the loop.

The valve is the emulator's, with events to the microsecond; 4 to 20 mA are its span when it has no friction. The
process is of first order with a dead time, or integrates; PV and OP are in percent.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from plant_emulator import valve
from plant_emulator.presets import plant_settings

if TYPE_CHECKING:
    from plant_emulator.parameters import PlantSettings

Array = NDArray[np.float64]
PERIOD_S = 1.0
_WARM_UP = 400
"""Samples before the record begins; the loop starts with a load that it does not know."""
_GAIN_N_PER_MA = 0.06452 * 5171.06775
_SPAN_M = 0.127


class Kind(StrEnum):
    STICKING = "sticking"
    HEALTHY = "healthy"
    TIGHT = "tight"
    SINE = "sine"
    STEPS = "steps"


@dataclass(frozen=True)
class Loop:
    """One loop: what it is, and what the seed drew of it."""

    kind: Kind
    stick_percent: float
    jump_percent: float
    seed: int
    samples: int = 3000

    @cached_property
    def plant(self) -> PlantSettings:
        """The valve: S and J in percent of 16 mA give F_s and F_c (Choudhury)."""
        static_n = 0.5 * (self.stick_percent + self.jump_percent) * 0.16 * _GAIN_N_PER_MA
        coulomb_n = 0.5 * (self.stick_percent - self.jump_percent) * 0.16 * _GAIN_N_PER_MA
        changes = {
            "spring_rate_n_per_m": 16.0 * _GAIN_N_PER_MA / _SPAN_M,
            "bench_set_n": 4.0 * _GAIN_N_PER_MA,
            "static_friction_n": static_n,
            "coulomb_friction_n": coulomb_n,
            "travel_min_m": -0.05,
            "travel_max_m": 0.18,
            "initial_position_m": 0.5 * _SPAN_M,
        }
        return plant_settings("paper", {"valve": changes, "sensor": {"noise_of_reading": 0.0}})


@dataclass(frozen=True)
class Played:
    """What was recorded, in percent; the stem is what a position sensor reads."""

    loop: Loop
    op: Array
    pv: Array
    sp: Array
    stem: Array


def play(loop: Loop, stem_noise: float = 0.05) -> Played:
    """Return the record of a loop; stem_noise is the standard deviation of the position reading, in % of span."""
    draw = np.random.default_rng(loop.seed)
    n = _WARM_UP + loop.samples
    integrates = draw.random() < 0.25
    lag_s, dead = float(draw.uniform(8.0, 40.0)), int(draw.integers(1, 12))
    gain = float(draw.uniform(0.6, 1.8))
    slope = gain / lag_s
    if loop.kind is Kind.TIGHT:
        closed = float(draw.uniform(-0.3, -0.1)) * dead  # a gain margin of 1.1 to 1.4
    else:
        closed = float(draw.uniform(1.0, 2.5)) * max(dead, 3)
    k_p = 1.0 / (slope * (closed + dead))
    reset_s = 4.0 * (closed + dead) if integrates else min(lag_s, 4.0 * (closed + dead))
    noise = float(draw.uniform(0.02, 0.15))
    load_noise = float(draw.uniform(0.05, 0.3))
    load_lag_s = float(draw.uniform(10.0, 100.0))
    offset = float(draw.choice((-1.0, 1.0)) * draw.uniform(1.0, 4.0))
    white, measured = draw.standard_normal(n), noise * draw.standard_normal(n)
    stem_error = stem_noise * draw.standard_normal(n)
    time = np.arange(n) * PERIOD_S
    load, keep = np.zeros(n), math.exp(-PERIOD_S / load_lag_s)
    for i in range(1, n):
        load[i] = keep * load[i - 1] + math.sqrt(1.0 - keep * keep) * load_noise * white[i]
    load += offset
    sp = np.full(n, 50.0)
    if loop.kind is Kind.SINE:
        period_s = float(draw.uniform(4.0, 12.0)) * (closed + dead + 10.0)
        load += float(draw.uniform(0.7, 3.0)) * np.sin(2.0 * math.pi * time / period_s)
    if loop.kind is Kind.STEPS:
        hold = int(draw.uniform(8.0, 20.0) * (closed + dead))
        levels = draw.uniform(-6.0, 6.0, n // hold + 1)
        sp += levels[np.arange(n) // hold]
    settings, state = loop.plant, valve.initial_state(loop.plant, loop.seed)
    op, pv, stem = np.empty(n), np.empty(n), np.empty(n)
    y, total, past = 50.0, 50.0, [50.0] * (dead + 1)
    for i in range(n):
        pv[i] = y + (load[i] if not integrates else 0.0) + measured[i]
        error = sp[i] - pv[i]
        wanted = k_p * error + total
        op[i] = min(max(wanted, 0.0), 100.0)
        if wanted == op[i]:
            total += k_p * error * PERIOD_S / reset_s
        state = valve.step(settings, state, 4.0 + 0.16 * op[i], PERIOD_S)
        stem[i] = 100.0 * state.stem.position_m / _SPAN_M
        past.append(stem[i])
        late = past[-1 - dead]
        if integrates:
            y += PERIOD_S * slope * (late - 50.0 + load[i])
        else:
            y += (1.0 - math.exp(-PERIOD_S / lag_s)) * (50.0 + gain * (late - 50.0) - y)
    op, pv, sp, stem = (each[_WARM_UP:] for each in (op, pv, sp, stem + stem_error))
    return Played(loop, op, pv, sp, stem)


def sticking_loops(count: int, least: float, most: float, seed: int) -> list[Loop]:
    """Return loops whose S goes from `least` to `most` percent, evenly by its logarithm, and J from 0.1 to 0.9 of S."""
    draw = np.random.default_rng(seed)
    sizes = np.geomspace(least, most, count)
    return [Loop(Kind.STICKING, float(s), float(s * draw.uniform(0.1, 0.9)), seed + i) for i, s in enumerate(sizes)]


def other_loops(kind: Kind, count: int, seed: int) -> list[Loop]:
    """Return loops whose valve has a dead band up to 0.3 %, and no slip jump."""
    draw = np.random.default_rng(seed)
    return [Loop(kind, float(draw.uniform(0.0, 0.3)), 0.0, seed + i) for i in range(count)]
