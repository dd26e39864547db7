"""A slide of the stem under a pressure that changes, in closed form, with its derivatives. Pure.

m·v̇ = B·p(t) - F_0 - K·x - F_v·v - s·F_c, with p(t) one piece of a `course`, is linear: a particular solution with the
form of p(t), and the free motion of `motion.modes`. Where s·v reaches 0 the stem stops and stays; that instant is a
root of a sum of exponentials, found by Newton's method inside a bracket. Under a steady pressure it is `motion.step`,
to the bit. Eq. 4's Stribeck term is left out, as there.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.values import dataclass
from positioner.valve.motion import modes, stop_time_s

if TYPE_CHECKING:
    from positioner.valve.course import Piece
    from positioner.valve.motion import Load, MotionModel

_CLASH = 1e-10
"""A rate of the pressure is a pole of the stem while the terms of that pole's equation cancel to this part."""
_APART = 2e-5
"""It is then taken larger by this part."""
_MOST_STEPS = 60
_CLOSE_S = 1e-9
"""The stop is found to this time; the place then errs by less than 1e-15 m."""


@dataclass(frozen=True, slots=True)
class Slid:
    """The end of a slide over one piece: x (m), v (m/s), whether it stopped, when (s), and the free motion until then.

    x_x, x_v, v_x, v_v: derivatives of x and v to x and v at the beginning; where the stem stopped, those of v are 0.
    """

    x: float
    v: float
    stopped: bool
    t: float
    x_x: float
    x_v: float
    v_x: float
    v_v: float


@dataclass(frozen=True, slots=True)
class _Arc:
    """The motion over one piece: x = steady + slope t + near e^(-near_rate t) + far e^(-far_rate t) + free motion."""

    half: float
    stiffness: float
    omega2: float
    steady_m: float
    slope: float
    near_m: float
    near_rate: float
    far_m: float
    far_rate: float
    free_m: float
    free_m_per_s: float

    def at(self, t: float) -> tuple[float, float, float]:
        """Return x (m), v (m/s) and the acceleration (m/s²) at the time `t` in s."""
        even, odd, _ = modes(self.half, self.omega2, self.stiffness, t)
        z = (even + self.half * odd) * self.free_m + odd * self.free_m_per_s
        w = -self.stiffness * odd * self.free_m + (even - self.half * odd) * self.free_m_per_s
        x, v = self.steady_m + self.slope * t + z, self.slope + w
        acceleration = -2.0 * self.half * w - self.stiffness * z
        if self.near_m:
            part = self.near_m * math.exp(-self.near_rate * t)
            x, v = x + part, v - self.near_rate * part
            acceleration += self.near_rate * self.near_rate * part
        if self.far_m:
            part = self.far_m * math.exp(-self.far_rate * t)
            x, v = x + part, v - self.far_rate * part
            acceleration += self.far_rate * self.far_rate * part
        return x, v, acceleration


@dataclass(frozen=True, slots=True)
class DrivenSlide:
    """Slides in `direction` (±1) against `load`."""

    model: MotionModel
    load: Load
    direction: float
    half: float
    stiffness: float
    omega2: float

    def along(self, piece: Piece, x: float, v: float) -> Slid:
        """Return the motion from x (m) and v (m/s) over `piece`, until the stem stops.

        A stem that rests and is not pushed forward, or that moves against the direction, has stopped at once.
        """
        if not (piece.slope_ma_per_s or piece.near_ma or piece.far_ma):
            end, t = (
                self.model.step(x, v, piece.steady_ma, self.load, self.direction, piece.duration_s),
                piece.duration_s,
            )
            if end.stopped and piece.near_rate:
                z = (
                    x
                    - self.model.push_n(piece.steady_ma, self.direction, self.load.friction_n)
                    / self.load.spring_n_per_m
                )
                t = stop_time_s(z, v, self.half, self.omega2, self.stiffness, self.direction)
            return Slid(end.x, end.v, end.stopped, t, end.dx_dx, end.dx_dv, end.dv_dx, end.dv_dv)
        arc, s = self._arc(piece, x, v), self.direction
        _, _, begin = arc.at(0.0)
        if s * v < 0.0 or (v == 0.0 and s * begin <= 0.0):
            return Slid(x, 0.0, True, 0.0, 1.0, 0.0, 0.0, 0.0)
        # within a long piece the stem may stop and start again: by parts that are short for what happens in them
        quarter_s = math.pi / (2.0 * math.sqrt(self.omega2)) if self.omega2 > 0.0 else math.inf
        low_s, part_s = 0.0, 1.0 / max(self.half, arc.near_rate, arc.far_rate)
        while True:
            high_s = min(low_s + min(part_s, quarter_s), piece.duration_s)
            part_s *= 2.0
            end_x, end_v, end_a = arc.at(high_s)
            if s * end_v <= 0.0:
                return self._stopped(arc, low_s, high_s)
            if s * begin < 0.0 < s * end_a:
                least_s = _turning_s(arc, s, low_s, high_s)
                if s * arc.at(least_s)[1] <= 0.0:
                    return self._stopped(arc, low_s, least_s)
            if high_s >= piece.duration_s:
                return self._slid(end_x, end_v, high_s, stopped=False)
            low_s, begin = high_s, end_a

    def driven(self, rate: float, slid: Slid) -> tuple[float, float]:
        """Return the derivatives of x and v at the end of `slid` to an addition to p(t) of e^(-rate t), per mA."""
        rate, pole = self._pole(rate)
        amplitude, e = self.model.gain_n_per_ma / pole, math.exp(-rate * slid.t)
        x_ma = amplitude * (e - slid.x_x + rate * slid.x_v)
        return x_ma, 0.0 if slid.stopped else amplitude * (rate * (slid.v_v - e) - slid.v_x)

    def _arc(self, piece: Piece, x: float, v: float) -> _Arc:
        gain, rate, drag = self.model.gain_n_per_ma, self.load.spring_n_per_m, self.load.viscous_n_s_per_m
        slope = gain * piece.slope_ma_per_s / rate
        steady_m = self.model.push_n(piece.steady_ma, self.direction, self.load.friction_n) / rate - drag * slope / rate
        near_m, near_rate, far_m, far_rate = 0.0, 0.0, 0.0, 0.0
        if piece.near_ma:
            near_rate, pole = self._pole(piece.near_rate)
            near_m = gain * piece.near_ma / pole
        if piece.far_ma:
            far_rate, pole = self._pole(piece.far_rate)
            far_m = gain * piece.far_ma / pole
        free_m, free_m_per_s = x - steady_m - near_m - far_m, v - slope + near_rate * near_m + far_rate * far_m
        return _Arc(
            self.half,
            self.stiffness,
            self.omega2,
            steady_m,
            slope,
            near_m,
            near_rate,
            far_m,
            far_rate,
            free_m,
            free_m_per_s,
        )

    def _pole(self, rate: float) -> tuple[float, float]:
        """Return `rate` r, if need be apart from a pole of the stem, and m r² - F_v r + K, which is 0 at a pole."""
        inertia, drag = self.model.mass_kg * rate * rate, self.load.viscous_n_s_per_m * rate
        pole = inertia - drag + self.load.spring_n_per_m
        if abs(pole) < _CLASH * (inertia + drag + self.load.spring_n_per_m):
            rate *= 1.0 + _APART
            pole = (self.model.mass_kg * rate - self.load.viscous_n_s_per_m) * rate + self.load.spring_n_per_m
        return rate, pole

    def _stopped(self, arc: _Arc, low_s: float, high_s: float) -> Slid:
        """Return the stop between `low_s`, where the stem moves, and `high_s`, where it would have turned."""
        s, t = self.direction, high_s
        for _ in range(_MOST_STEPS):
            _, v, a = arc.at(t)
            if s * v > 0.0:
                low_s = t
            else:
                high_s = t
            step_s = v / a if a else math.inf
            new_s = t - step_s
            if not low_s < new_s < high_s:
                new_s = (low_s + high_s) / 2.0
            if abs(new_s - t) < _CLOSE_S:
                break
            t = new_s
        return self._slid(arc.at(t)[0], 0.0, t, stopped=True)

    def _slid(self, x: float, v: float, t: float, *, stopped: bool) -> Slid:
        even, odd, _ = modes(self.half, self.omega2, self.stiffness, t)
        x_x, x_v = even + self.half * odd, odd
        if stopped:
            return Slid(x, 0.0, True, t, x_x, x_v, 0.0, 0.0)
        return Slid(x, v, False, t, x_x, x_v, -self.stiffness * odd, even - self.half * odd)


def driven_slide(model: MotionModel, load: Load, direction: float) -> DrivenSlide:
    """Return the slides against `load` in `direction` (±1)."""
    half, stiffness = load.viscous_n_s_per_m / (2.0 * model.mass_kg), load.spring_n_per_m / model.mass_kg
    return DrivenSlide(model, load, direction, half, stiffness, stiffness - half * half)


def _turning_s(arc: _Arc, s: float, low_s: float, high_s: float) -> float:
    """Return where the speed is least between `low_s`, where the stem brakes, and `high_s`, where it no longer does."""
    for _ in range(_HALVINGS):
        middle_s = (low_s + high_s) / 2.0
        if s * arc.at(middle_s)[2] < 0.0:
            low_s = middle_s
        else:
            high_s = middle_s
    return high_s


_HALVINGS = 30
