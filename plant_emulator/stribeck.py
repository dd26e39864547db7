"""Sliding so slowly that Stribeck's curve matters: Dormand-Prince 5(4), with events located. Pure.

Below about five V_s the motion has no closed form, and it is fast: the friction falls by (F_s - F_c)/V_s per unit of
speed, and the time constants are microseconds. The allowed error per step is far below the resolution of any sensor.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from plant_emulator.path import Knots
from plant_emulator.roots import crossing
from plant_emulator.segment import Ending, Segment
from positioner.values import dataclass

if TYPE_CHECKING:
    from plant_emulator.force import PushingForce

_TOLERANCE_M_PER_S = 1e-12
_RELATIVE_TOLERANCE = 1e-10
_FIRST_STEP = 0.2
"""Of the shortest time constant of the motion."""


@dataclass(frozen=True, slots=True)
class _Point:
    """A state on the way: x in m, v in m/s, a in m/s², and the error of the step to it; 1 is the largest allowed."""

    x: float
    v: float
    a: float
    error: float


@dataclass(frozen=True, slots=True, kw_only=True)
class StribeckSlide:
    """Motion in the direction `sign` against `load_n` (preload and s·F_c) and the Stribeck part of friction."""

    force: PushingForce
    sign: int
    mass_kg: float
    spring_n_per_m: float
    viscous_n_s_per_m: float
    load_n: float
    drop_n: float
    """F_s - F_c."""
    stribeck_velocity_m_per_s: float

    def run(self, x: float, v: float, horizon_s: float, low: float, high: float, border_m: float) -> Segment:
        """Return the segment from `x` and `v`, until the speed falls to `low` or the stem reaches `border_m`.

        A speed above `high` ends it, too, as OPEN: there the curve is flat and the closed form follows.
        """
        t, point = 0.0, _Point(x, v, self._acceleration(0.0, x, v), 0.0)
        knots = [(0.0, x, v, point.a)]
        bend = self.drop_n / self.stribeck_velocity_m_per_s + self.viscous_n_s_per_m
        h = _FIRST_STEP / (bend / self.mass_kg + abs(point.a) / self.stribeck_velocity_m_per_s)
        while True:
            last = h >= horizon_s - t
            if last:
                h = horizon_s - t
            trial = self._step(t, point, h)
            if trial.error > 1.0:
                h *= max(0.2, 0.9 * trial.error**-0.2)
                continue
            if self.sign * point.v <= low and self.sign * trial.v < low and self.sign * point.a > 0.0:
                # the speed starts at the bound, rises, and falls below it within the step: only the fall is an event
                h *= 0.5
                continue
            event = self._event(t, point, h, trial, low, border_m, knots)
            if event is not None:
                return event
            t, point = t + h, trial
            knots.append((t, trial.x, trial.v, trial.a))
            if last:
                return Segment(horizon_s, trial.x, trial.v, Ending.OPEN, Knots(knots))
            if self.sign * trial.v >= high:
                return Segment(t, trial.x, trial.v, Ending.OPEN, Knots(knots))
            h *= min(5.0, 0.9 * (trial.error + 1e-5) ** -0.2)

    def _event(
        self,
        t: float,
        start: _Point,
        h: float,
        end: _Point,
        low: float,
        border_m: float,
        knots: list[tuple[float, float, float, float]],
    ) -> Segment | None:
        """Return the segment up to the first event inside the step from `start` to `end`, or None."""
        sign, until = self.sign, h
        lowest_h, lowest = h, end
        if sign * start.a < 0.0 < sign * end.a:
            lowest_h = crossing(lambda part: self._step(t, start, part).a, 0.0, h)
            lowest = self._step(t, start, lowest_h)
        slow = sign * lowest.v < low
        if slow:
            until = crossing(lambda part: sign * self._step(t, start, part).v - low, 0.0, lowest_h)
            end = self._step(t, start, until)
        beyond = sign * (end.x - border_m) >= 0.0
        if not (beyond or slow):
            return None
        if beyond:
            until = crossing(lambda part: self._step(t, start, part).x - border_m, 0.0, until)
            end = self._step(t, start, until)
        path = Knots([*knots, (t + until, end.x, end.v, end.a)])
        if beyond:
            return Segment(t + until, border_m, end.v, Ending.BORDER, path)
        return Segment(t + until, end.x, sign * low, Ending.SPEED, path)

    def _acceleration(self, t: float, x: float, v: float) -> float:
        ratio = v / self.stribeck_velocity_m_per_s
        dry = self.load_n + self.sign * self.drop_n * math.exp(-ratio * ratio)
        return (self.force.at(t) - dry - self.spring_n_per_m * x - self.viscous_n_s_per_m * v) / self.mass_kg

    def _step(self, t: float, point: _Point, h: float) -> _Point:
        """Return the state `h` after `point` by one step of Dormand and Prince (1980)."""
        x, v, a1 = point.x, point.v, point.a
        rate = self._acceleration
        v2 = v + h * (0.2 * a1)
        a2 = rate(t + 0.2 * h, x + h * (0.2 * v), v2)
        v3 = v + h * (3 / 40 * a1 + 9 / 40 * a2)
        a3 = rate(t + 0.3 * h, x + h * (3 / 40 * v + 9 / 40 * v2), v3)
        v4 = v + h * (44 / 45 * a1 - 56 / 15 * a2 + 32 / 9 * a3)
        a4 = rate(t + 0.8 * h, x + h * (44 / 45 * v - 56 / 15 * v2 + 32 / 9 * v3), v4)
        v5 = v + h * (19372 / 6561 * a1 - 25360 / 2187 * a2 + 64448 / 6561 * a3 - 212 / 729 * a4)
        x5 = x + h * (19372 / 6561 * v - 25360 / 2187 * v2 + 64448 / 6561 * v3 - 212 / 729 * v4)
        a5 = rate(t + 8 / 9 * h, x5, v5)
        v6 = v + h * (9017 / 3168 * a1 - 355 / 33 * a2 + 46732 / 5247 * a3 + 49 / 176 * a4 - 5103 / 18656 * a5)
        x6 = x + h * (9017 / 3168 * v - 355 / 33 * v2 + 46732 / 5247 * v3 + 49 / 176 * v4 - 5103 / 18656 * v5)
        a6 = rate(t + h, x6, v6)
        x7 = x + h * (35 / 384 * v + 500 / 1113 * v3 + 125 / 192 * v4 - 2187 / 6784 * v5 + 11 / 84 * v6)
        v7 = v + h * (35 / 384 * a1 + 500 / 1113 * a3 + 125 / 192 * a4 - 2187 / 6784 * a5 + 11 / 84 * a6)
        a7 = rate(t + h, x7, v7)
        defect = h * (
            71 / 57600 * a1 - 71 / 16695 * a3 + 71 / 1920 * a4 - 17253 / 339200 * a5 + 22 / 525 * a6 - 1 / 40 * a7
        )
        return _Point(x7, v7, a7, abs(defect) / (_TOLERANCE_M_PER_S + _RELATIVE_TOLERANCE * abs(v7)))
