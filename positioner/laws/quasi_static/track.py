"""Where a stem is in a slip, by readings and by the rollout: a Kalman filter over x, v and the push. Pure.

The push is what moves the stem beside the pressure: a force, or friction that differs in this slip. While the stem is
stuck only the readings say whether it was freed: once they are 5 σ beyond its place it slides, from there on with the
acceleration of a stem that has just been freed.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.values import dataclass
from positioner.valve.rollout import Moving
from positioner.valve.state import StemState

if TYPE_CHECKING:
    from positioner.valve.rollout import Rollout

_FREED, _FREED_M = 5.0, 1e-4
"""σ of a reading that a stem which was not expected to move must have moved, and its least."""
_OWN_M2 = 1e-10
"""Variance that a sample adds to the place: 0.01 mm, the motion within a step of the rollout."""
_LEAST_MA2 = 1e-8
"""Least variance of the push: 0.1 μA, less than any current is resolved to."""
_SLOWEST_M_PER_S = 1e-6
"""A stem that slides by the rollout goes on in its direction: readings do not turn it around."""


@dataclass(frozen=True, slots=True)
class Track:
    """x in m, v in m/s and the push in mA (in `moving`), and their covariance."""

    moving: Moving
    xx: float
    xv: float = 0.0
    xp: float = 0.0
    vv: float = 0.0
    vp: float = 0.0
    pp: float = 0.0

    def after(
        self, rollout: Rollout, current_ma: float, measured_m: float, reading_m2: float, direction: float
    ) -> Track:
        """Return the track one sample later.

        Args:
            rollout: the motion of the valve.
            current_ma: commanded during the sample.
            measured_m: the reading at its end.
            reading_m2: variance of a reading.
            direction: of the move, ±1.
        """
        moving = rollout.after(self.moving, current_ma)
        stem = moving.stem
        if not stem.stuck:
            return self._slid(rollout, moving, measured_m, reading_m2)
        gone_m = direction * (measured_m - stem.position_m)
        if self.moving.stem.stuck and gone_m > _FREED * math.sqrt(self.xx + reading_m2) + _FREED_M:
            numbers = rollout.numbers
            speed = math.sqrt(2.0 * gone_m * (numbers.static_ma - numbers.sliding_ma) / rollout.up.model.mass_kg)
            stem = StemState(measured_m, direction * speed, False, direction)
            moving = Moving(moving.pressure, stem, moving.shift_ma)
            return Track(moving, reading_m2, 0.0, 0.0, speed * speed, 0.0, self.pp)
        return Track(moving, self.xx, self.xv, self.xp, self.vv, self.vp, max(self.pp, _LEAST_MA2))

    def _slid(self, rollout: Rollout, moving: Moving, measured_m: float, reading_m2: float) -> Track:
        """Return the track of a stem that slides, after a reading: the covariance in the steps of the rollout."""
        stem, xx, xv, xp, vv, vp, pp = moving.stem, self.xx, self.xv, self.xp, self.vv, self.vp, self.pp
        slide = rollout.up if stem.direction > 0.0 else rollout.down
        fx, fv, fp, gx, gv, gp = slide.x_x, slide.x_v, slide.x_ma, slide.v_x, slide.v_v, slide.v_ma
        for _ in range(rollout.steps):
            a0, a1, a2 = fx * xx + fv * xv + fp * xp, fx * xv + fv * vv + fp * vp, fx * xp + fv * vp + fp * pp
            b0, b1, b2 = gx * xx + gv * xv + gp * xp, gx * xv + gv * vv + gp * vp, gx * xp + gv * vp + gp * pp
            xx, xv, xp = a0 * fx + a1 * fv + a2 * fp, a0 * gx + a1 * gv + a2 * gp, a2
            vv, vp = b0 * gx + b1 * gv + b2 * gp, b2
        xx += _OWN_M2
        innovation_m = measured_m - stem.position_m
        gain_x, gain_v, gain_p = (of / (xx + reading_m2) for of in (xx, xv, xp))
        velocity = stem.velocity_m_per_s + gain_v * innovation_m
        if stem.direction * velocity <= 0.0:
            velocity = _SLOWEST_M_PER_S * stem.direction
        stem = StemState(stem.position_m + gain_x * innovation_m, velocity, False, stem.direction)
        moving = Moving(moving.pressure, stem, moving.shift_ma + gain_p * innovation_m)
        vv, vp, pp = vv - gain_v * xv, vp - gain_v * xp, pp - gain_p * xp
        xx, xv, xp = xx - gain_x * xx, xv - gain_x * xv, xp - gain_x * xp
        return Track(moving, xx, xv, xp, max(vv, 0.0), vp, max(pp, _LEAST_MA2))
