"""A stem with spring and friction, integrated in small steps: what the tests of `health` measure. No plant emulator."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from positioner.health.move import Move, MoveSettings
from positioner.health.moves import MoveTracker, follow
from positioner.health.reference import Reference
from positioner.valve.motion import Load, MotionModel

GAIN, SPRING, SLIDING, STATIC, VISCOUS, MASS, SPAN = 333.637, 52538.0, 1423.0, 1707.7, 612.9, 1.361, 0.127
PERIOD_S = 1e-3
SETTINGS = MoveSettings(MotionModel(MASS, GAIN, 0.0), Load(SPRING, SLIDING, VISCOUS), 0.0, 0.0005 * SPAN, PERIOD_S)
REFERENCE = Reference("identify", "2026-01-01", SPRING, 0.0, SLIDING, STATIC, (), 0.0, 0.1397, SPAN)


@dataclass
class Stem:
    """A stem at rest; `play` moves it under currents of one period each, in steps of step_s."""

    position_m: float = 0.07
    speed_m_per_s: float = 0.0
    friction: float = 1.0
    spring: float = 1.0
    offset_ma: float = 0.0
    supply_ma: float = 100.0
    step_s: float = 5e-6

    def play(self, current_ma: float, period_s: float = PERIOD_S) -> float:
        push_ma = min(current_ma + self.offset_ma, self.supply_ma)
        for _ in range(round(period_s / self.step_s)):
            free_n = GAIN * push_ma - self.spring * SPRING * self.position_m
            if self.speed_m_per_s == 0.0 and abs(free_n) <= self.friction * STATIC:
                break
            side = math.copysign(1.0, self.speed_m_per_s or free_n)
            force_n = free_n - side * self.friction * SLIDING - VISCOUS * self.speed_m_per_s
            speed = self.speed_m_per_s + force_n / MASS * self.step_s
            if speed * side <= 0.0:
                self.speed_m_per_s = 0.0
                continue
            self.position_m += 0.5 * (speed + self.speed_m_per_s) * self.step_s
            self.speed_m_per_s = speed
        return self.position_m


def moves_of(
    stem: Stem,
    currents_ma: list[float],
    sigma_m: float = 0.0,
    seed: int = 1,
    period_s: float = PERIOD_S,
    scatter: float = 0.0,
) -> list[Move]:
    """Return the moves that are seen while the stem is played with these currents.

    scatter: standard deviation of the friction from one current to the next that differs, as a part of it.
    """
    tracker, noise, found = MoveTracker(), np.random.default_rng(seed), []
    settings, before_ma = replace(SETTINGS, period_s=period_s), math.nan
    for number, current_ma in enumerate(currents_ma):
        if scatter and current_ma != before_ma:
            stem.friction, before_ma = 1.0 + scatter * float(noise.standard_normal()), current_ma
        reading_m = stem.play(current_ma, period_s) + sigma_m * float(noise.standard_normal())
        move = follow(settings, tracker, number * period_s, period_s, reading_m, current_ma)
        if move is not None:
            found.append(move)
    return found


def pushes(count: int, seed: int = 1) -> list[float]:
    """Return currents that push the stem up and down in turn, by 4 to 12 mm, with rests between."""
    rng, found = np.random.default_rng(seed), [11.0] * 60
    low_ma, high_ma = 5.5, 16.0
    for number in range(count):
        middle_ma = 11.0
        push_ma = high_ma + float(rng.uniform(0.5, 3.5)) if number % 2 == 0 else low_ma - float(rng.uniform(0.0, 1.4))
        found += [push_ma] * 20 + [middle_ma] * 60
    return found
