"""The stem along one segment: its position at any instant, and what a sensor with a lag shows of it. Pure."""

from __future__ import annotations

import math
from typing import Protocol

_NODES = ((-0.8611363115940526, 0.3478548451374538), (-0.3399810435848563, 0.6521451548625461),
          (0.3399810435848563, 0.6521451548625461), (0.8611363115940526, 0.3478548451374538))  # fmt: skip
"""Gauss and Legendre's four nodes and weights from -1 to 1; exact for polynomials of degree 7."""
_PANEL = 0.5
"""Of the lag: the longest piece that is integrated at once; the error of one is below 1e-9 of the motion in it."""


class Path(Protocol):
    """What the motion of a segment offers; times are from its start."""

    def position(self, t: float) -> float:
        """Return the position in m after `t` seconds."""

    def lagged(self, t: float, rate: float) -> float:
        """Return what a sensor with the lag 1/`rate` shows of the motion after `t` seconds, in m; it began at 0."""


class Uniform:
    """Rest, or motion at a constant speed."""

    __slots__ = ("start", "velocity")

    def __init__(self, position_m: float, velocity_m_per_s: float) -> None:
        """Start at `position_m`."""
        self.start = position_m
        self.velocity = velocity_m_per_s

    def position(self, t: float) -> float:
        """Return the position in m after `t` seconds."""
        return self.start + self.velocity * t

    def lagged(self, t: float, rate: float) -> float:
        """Return what a sensor with the lag 1/`rate` shows of the motion after `t` seconds, in m; it began at 0."""
        lagging = 1.0 - math.exp(-rate * t)
        return self.start * lagging + self.velocity * (t - lagging / rate)


class Knots:
    """A motion that was integrated, as (time, position, velocity, acceleration) at the ends of its steps.

    Between them it is the polynomial of degree 5 with these values. Its error is far below that of the integration: the
    steps are short against the time constants of the motion.
    """

    __slots__ = ("knots",)

    def __init__(self, knots: list[tuple[float, float, float, float]]) -> None:
        """Take `knots`, the first of them at time 0."""
        self.knots = knots

    def position(self, t: float) -> float:
        """Return the position in m after `t` seconds."""
        index = 1
        while index < len(self.knots) - 1 and self.knots[index][0] < t:
            index += 1
        return _between(self.knots[index - 1], self.knots[index], t)

    def lagged(self, t: float, rate: float) -> float:
        """Return what a sensor with the lag 1/`rate` shows of the motion after `t` seconds, in m; it began at 0."""
        # relative to the start, so that a panel's error is relative to the motion in it
        begin_m, shown_m = self.knots[0][1], 0.0
        for start, end in zip(self.knots, self.knots[1:], strict=False):
            left_s = min(t, end[0]) - start[0]
            if left_s <= 0.0:
                break
            panels = math.ceil(rate * left_s / _PANEL)
            half_s = 0.5 * left_s / panels
            for panel in range(panels):
                middle_s = start[0] + (2 * panel + 1) * half_s
                gained_m = 0.0
                for node, weight in _NODES:
                    ahead_m = _between(start, end, middle_s + half_s * node) - begin_m
                    gained_m += weight * math.exp(rate * half_s * (node - 1.0)) * ahead_m
                shown_m = shown_m * math.exp(-2.0 * rate * half_s) + rate * half_s * gained_m
        return begin_m * (1.0 - math.exp(-rate * t)) + shown_m


def _between(start: tuple[float, float, float, float], end: tuple[float, float, float, float], t: float) -> float:
    """Return the position in m at `t` on Hermite's polynomial of degree 5 from `start` to `end`."""
    begin_s, x, v, a = start
    h = end[0] - begin_s
    if h <= 0.0:
        return x
    # what the end has beyond a motion with the constant acceleration of the start
    dx = end[1] - x - h * (v + 0.5 * h * a)
    dv = (end[2] - v - h * a) * h
    da = (end[3] - a) * h * h
    c3 = 10.0 * dx - 4.0 * dv + 0.5 * da
    c4 = -15.0 * dx + 7.0 * dv - da
    c5 = 6.0 * dx - 3.0 * dv + 0.5 * da
    s, part = t - begin_s, (t - begin_s) / h
    return x + s * (v + 0.5 * s * a) + part * part * part * (c3 + part * (c4 + part * c5))
