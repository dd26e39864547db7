"""Where a stem is in a slip, by readings and by the rollout: a Kalman filter over x, v and the push. Pure.

The push is what moves the stem beside the pressure: a force, or friction that differs in this slip. Readings alone say
whether a stem was freed: once one is 5 σ beyond its place, it slides, and static friction was as large as it must have
been for the rollout to bring it there by now. Where readings are so noisy that 5 σ are more than a slip jump, they come
too late, and the stem is freed by the friction that is believed.
"""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING

from positioner.values import dataclass, replace
from positioner.valve.rollout import Moving
from positioner.valve.sensor import NO_LAG
from positioner.valve.state import StemState

if TYPE_CHECKING:
    from positioner.valve.pressure import PressureState
    from positioner.valve.rollout import Rollout
    from positioner.valve.sensor import SensorLag
    from positioner.valve.slide import Slide

_FREED, _FREED_M = 5.0, 1e-4
"""σ of a reading, and its least, by which a stem must have moved to be seen to slide."""
_OWN_M2 = 1e-10
"""Variance that a sample adds to the place: 0.01 mm, the motion within a step of the rollout."""
_LEAST_MA2 = 1e-8
"""Least variance of the push: 0.1 μA, less than any current is resolved to."""
_SLOWEST_M_PER_S = 1e-6
"""A stem that slides by the rollout goes on in its direction: readings do not turn it around."""
_WINDOW_S = 0.04
"""A slip that is now seen has begun within it: a slip of the paper's valve is over after 0.016 s."""
_BISECTIONS, _BESIDE_MA = 10, 0.02
"""Of static friction, to a thousandth of what the pressure rises in the window; its step for derivatives."""
_NOT_FREED_M = 1e-7
"""What the sensor shows changes by less where static friction does not matter: the pressure has freed nothing."""
_LONGEST = 4000
"""Samples after which a slip is no longer foreseen (`slip`)."""
_MOVES = 2.0
"""σ of its speed by which a stem moves for certain."""
_SURPRISE = 9.0
"""Squared difference of static friction over its variance that is no chance."""


@dataclass(frozen=True, slots=True)
class Reading:
    """What comes with a cycle: the current in mA that was commanded, and the reading at the end of the sample.

    variance_m2: of the reading. sensor: its lag.
    """

    current_ma: float
    measured_m: float
    variance_m2: float
    sensor: SensorLag = NO_LAG

    @property
    def own_m2(self) -> float:
        """Variance of what the reading says of the place, where the sensor's lag is undone."""
        left, part = self.sensor.left, 1.0 - self.sensor.left
        return self.variance_m2 * (1.0 + left * left) / (part * part)


@dataclass(frozen=True, slots=True)
class Doubt:
    """The covariance of x in m, v in m/s and the push p in mA."""

    xx: float
    pp: float
    xv: float = 0.0
    xp: float = 0.0
    vv: float = 0.0
    vp: float = 0.0

    def ahead(self, slide: Slide, steps: int, roams_ma2: float) -> Doubt:
        """Return the covariance after so many steps of a slide, in which the push gains the variance roams_ma2."""
        xx, xv, xp, vv, vp, pp = self.xx, self.xv, self.xp, self.vv, self.vp, self.pp
        fx, fv, fp, gx, gv, gp = slide.x_x, slide.x_v, slide.x_ma, slide.v_x, slide.v_v, slide.v_ma
        for _ in range(steps):
            a0, a1, a2 = fx * xx + fv * xv + fp * xp, fx * xv + fv * vv + fp * vp, fx * xp + fv * vp + fp * pp
            b0, b1, b2 = gx * xx + gv * xv + gp * xp, gx * xv + gv * vv + gp * vp, gx * xp + gv * vp + gp * pp
            xx, xv, xp = a0 * fx + a1 * fv + a2 * fp, a0 * gx + a1 * gv + a2 * gp, a2
            vv, vp = b0 * gx + b1 * gv + b2 * gp, b2
        return Doubt(xx + _OWN_M2, pp + roams_ma2, xv, xp, vv, vp)

    def gains(self, reading_m2: float) -> tuple[float, float, float]:
        """Return by how much x, v and p follow a reading of x that has this variance."""
        total_m2 = self.xx + reading_m2
        return self.xx / total_m2, self.xv / total_m2, self.xp / total_m2

    def read(self, reading_m2: float) -> Doubt:
        """Return the covariance after such a reading."""
        xx, xv, xp = self.xx, self.xv, self.xp
        gain_x, gain_v, gain_p = self.gains(reading_m2)
        vv, pp = max(self.vv - gain_v * xv, 0.0), max(self.pp - gain_p * xp, _LEAST_MA2)
        return Doubt(xx - gain_x * xx, pp, xv - gain_x * xv, xp - gain_x * xp, vv, self.vp - gain_v * xp)


@dataclass(frozen=True, slots=True)
class Track:
    """x in m, v in m/s and the push in mA (in `moving`), and how far they are doubted.

    ss: variance in mA² of the static friction that is believed, above 0. last_m: the newest reading. before: while the
    stem is stuck and the push exceeds F_c, the pressure before each of the newest samples. roams_ma2_per_m: variance
    that the push gains on the way. reading_m2: `own_m2` of the newest reading. misfit, read: sum of squared innovations
    over their variances, and their number.
    """

    moving: Moving
    doubt: Doubt
    ss: float
    last_m: float
    roams_ma2_per_m: float = 0.0
    reading_m2: float = 0.0
    before: tuple[PressureState, ...] = ()
    misfit: float = 0.0
    read: int = 0

    @property
    def has_not_slid(self) -> bool:
        """Whether the stem is stuck, and no reading was taken while it slid."""
        return self.moving.stem.stuck and not self.read

    @property
    def may_rest(self) -> bool:
        """Whether the stem may have stopped by now: once it has, more pressure lets it jump."""
        stem = self.moving.stem
        return stem.stuck or stem.velocity_m_per_s * stem.velocity_m_per_s < _MOVES * _MOVES * self.doubt.vv

    def after(self, rollout: Rollout, reading: Reading) -> Track:
        """Return the track one sample later; while the stem is stuck, the current is the same in all samples."""
        moving, measured_m = self.moving, reading.measured_m
        stem, least_m = moving.stem, _FREED * math.sqrt(self.doubt.xx + reading.variance_m2) + _FREED_M
        if not stem.stuck or least_m > rollout.numbers.jump_m:
            return self._slid(rollout, rollout.after(moving, reading.current_ma), reading)
        held = _with_static(rollout, math.inf).after(moving, reading.current_ma)
        longest = math.ceil(_WINDOW_S / (rollout.steps * rollout.up.period_s))
        may_slide = _push_ma(rollout, held.pressure, stem) > rollout.numbers.sliding_ma
        before = (*self.before, moving.pressure)[-longest:] if may_slide else ()
        track = replace(self, moving=held, last_m=measured_m, reading_m2=reading.own_m2, before=before)
        gone_m = stem.direction * (measured_m - stem.position_m)
        if gone_m <= least_m:
            return track
        return track.freed(rollout, reading, gone_m)

    def freed(self, rollout: Rollout, reading: Reading, gone_m: float) -> Track:
        """Return the track of a stem that is first seen to slide, so far: what static friction has brought it there?"""
        numbers, stem, doubt, low_ma = rollout.numbers, self.moving.stem, self.doubt, rollout.numbers.sliding_ma
        direction, seen_m, beside_m = stem.direction, stem.position_m, stem.position_m
        if self.before:
            low_ma, high_ma = (_push_ma(rollout, of, stem) for of in (self.before[0], self.moving.pressure))
            low_ma = max(low_ma, numbers.sliding_ma)
            for _ in range(_BISECTIONS):
                static_ma = 0.5 * (low_ma + high_ma)
                if direction * (self._slip(rollout, reading, static_ma)[1] - reading.measured_m) > 0.0:
                    low_ma = static_ma
                else:
                    high_ma = static_ma
            seen_m, beside_m = (self._slip(rollout, reading, of_ma)[1] for of_ma in (low_ma, low_ma + _BESIDE_MA))
        if abs(seen_m - beside_m) < _NOT_FREED_M:  # no friction explains it, but a force
            speed = math.sqrt(2.0 * gone_m * (numbers.static_ma - numbers.sliding_ma) / rollout.up.model.mass_kg)
            moving = replace(self.moving, stem=StemState(reading.measured_m, direction * speed, False, direction))
            doubt = replace(doubt, xx=reading.variance_m2, vv=speed * speed)
            return replace(self, moving=moving, doubt=doubt, before=())
        slope = (beside_m - seen_m) / _BESIDE_MA
        pp, ss, more_ma = doubt.pp, reading.variance_m2 / (slope * slope), low_ma - numbers.static_ma
        if more_ma * more_ma > _SURPRISE * (self.ss + ss):  # another friction than is believed, or a force
            pp = max(pp, more_ma * more_ma)
        else:
            gain = self.ss / (self.ss + ss)
            more_ma, ss = gain * more_ma, gain * ss
        static_ma = numbers.static_ma + more_ma
        (found, _), (beside, _) = (self._slip(rollout, reading, of) for of in (static_ma, static_ma + _BESIDE_MA))
        x, v = found.position_m, found.velocity_m_per_s
        x_s, v_s = (beside.position_m - x) / _BESIDE_MA, (beside.velocity_m_per_s - v) / _BESIDE_MA
        v_p = 0.5 * abs(v) / max(static_ma - numbers.sliding_ma, _BESIDE_MA)
        v = direction * max(direction * v, _SLOWEST_M_PER_S)
        moving = replace(self.moving, stem=StemState(x, v, False, direction))
        xx, xv, vv = x_s * x_s * ss, x_s * v_s * ss, v_s * v_s * ss + v_p * v_p * pp
        doubt = replace(doubt, xx=xx, xv=xv, vv=vv, vp=v_p * pp, pp=pp)
        return replace(self, moving=moving, doubt=doubt, before=())

    def _slip(self, rollout: Rollout, reading: Reading, static_ma: float) -> tuple[StemState, float]:
        """Return the stem, and what the sensor shows of it, if static friction was so large before this slip."""
        free, moving = _with_static(rollout, static_ma), Moving(self.before[0], self.moving.stem)
        seen_m = moving.stem.position_m
        for _ in self.before:
            before_m, moving = moving.stem.position_m, free.after(moving, reading.current_ma)
            seen_m = reading.sensor.after(before_m, moving.stem.position_m, seen_m)
        return moving.stem, seen_m

    def _slid(self, rollout: Rollout, moving: Moving, reading: Reading) -> Track:
        """Return the track of a stem that slides, after a reading.

        What the sensor's lag does is undone: (z - e z')/(1 - e), z' the reading before, is between x before and now.
        """
        if moving.stem.stuck:
            return replace(self, moving=moving, last_m=reading.measured_m)
        left, part = reading.sensor.left, 1.0 - reading.sensor.left
        shown_m = reading.sensor.shown_m(self.moving.stem.position_m, moving.stem.position_m)
        innovation_m = (reading.measured_m - left * self.last_m) / part - shown_m
        ahead, reading_m2 = self._ahead(self.doubt, rollout, self.moving, moving), reading.own_m2
        gain_x, gain_v, gain_p = ahead.gains(reading_m2)
        stem = moving.stem
        velocity = stem.velocity_m_per_s + gain_v * innovation_m
        if stem.direction * velocity <= 0.0:
            velocity = _SLOWEST_M_PER_S * stem.direction
        stem = StemState(stem.position_m + gain_x * innovation_m, velocity, False, stem.direction)
        return replace(
            self,
            moving=Moving(moving.pressure, stem, moving.shift_ma + gain_p * innovation_m),
            doubt=ahead.read(reading_m2),
            last_m=reading.measured_m,
            reading_m2=reading_m2,
            misfit=self.misfit + innovation_m * innovation_m / (ahead.xx + reading_m2),
            read=self.read + 1,
        )

    def shown_m2(self, rollout: Rollout, currents: tuple[float, ...], hold_ma: float) -> float:
        """Return the variance of what the readings on the way will change of the stop, under these currents.

        That is what is doubted of the place where the stem stops if it is not read, less what is doubted if it is. The
        last readings do not count: what they lead to acts after the stop.
        """
        path = [self.moving]
        for moving in rollout.path(self.moving, (*currents, hold_ma)):
            path.append(moving)
            if moving.stem.stuck or len(path) > _LONGEST:
                break
        read = unread = self.doubt
        late = len(path) - 2 - rollout.pressure.waiting // rollout.steps
        for sample, (before, moving) in enumerate(itertools.pairwise(path)):
            read, unread = (self._ahead(doubt, rollout, before, moving) for doubt in (read, unread))
            if sample < late:
                read = read.read(self.reading_m2)
        return max(unread.xx - read.xx, 0.0)

    def _ahead(self, doubt: Doubt, rollout: Rollout, before: Moving, moving: Moving) -> Doubt:
        """Return how far a stem is doubted that slides from one place to another in a sample."""
        slide = rollout.up if moving.stem.direction > 0.0 else rollout.down
        roams_ma2 = self.roams_ma2_per_m * abs(moving.stem.position_m - before.stem.position_m)
        return doubt.ahead(slide, rollout.steps, roams_ma2)


def _push_ma(rollout: Rollout, pressure: PressureState, stem: StemState) -> float:
    """Return how much of the pressure pushes a stem in its direction, beyond its balance."""
    return stem.direction * (pressure.pressure_ma - rollout.numbers.balance_ma(stem.position_m))


def _with_static(rollout: Rollout, static_ma: float) -> Rollout:
    """Return the motion of the same valve with another static friction."""
    return replace(rollout, numbers=replace(rollout.numbers, static_ma=static_ma))
