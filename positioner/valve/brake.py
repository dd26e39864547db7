"""Where a sliding stem can be stopped: one sample of a current, then deadbeat commands to a braking pressure. Pure.

Under those commands the pressure goes at the limit of the loop for whole samples, arrives in one more, and stays.
Behind a converter with a lag it goes at the limit until the converter meets its aim, and then arrives exponentially. So
the place takes a few pieces of `driven_slide`, however long the stop lasts. It is the movable bound of the law, with
its derivatives to the state and to the current; they are carried back from the stop, piece by piece.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.values import dataclass
from positioner.valve.braking_course import Phase, braking_course

if TYPE_CHECKING:
    from positioner.valve.course import Piece
    from positioner.valve.drive import Drive
    from positioner.valve.driven_slide import DrivenSlide, Slid

_CLOSE_M = 1e-6
"""A predicted stop this close to the target is there."""
_MOST_PASSES = 8


@dataclass(frozen=True, slots=True)
class Stop:
    """Where the stem stops, in m, and the derivatives of that place to x, v, p, w and the current of the sample."""

    x: float
    x_x: float
    x_v: float
    x_p: float
    x_w: float
    x_u: float


@dataclass(frozen=True, slots=True)
class Brake:
    """Stops of `slide` with the deadbeat commands of `drive`."""

    slide: DrivenSlide
    drive: Drive

    def after(
        self, x: float, v: float, pressure_ma: float, converter_ma: float, current_ma: float
    ) -> tuple[float, float, float, float, bool]:
        """Return x, v, pressure and converter output after one sample, and whether the stem stopped in it."""
        stopped = False
        for piece in self.drive.course(pressure_ma, converter_ma, current_ma):
            end = self.slide.along(piece, x, v)
            x, v, stopped = end.x, end.v, end.stopped
            if stopped:
                break
        pressure_ma, converter_ma = self.drive.after(pressure_ma, converter_ma, current_ma)
        return x, v, pressure_ma, converter_ma, stopped

    def stop_m(
        self, x: float, v: float, pressure_ma: float, converter_ma: float, first_ma: float, brake_ma: float
    ) -> float:
        """Return where in m the stem stops after one sample under `first_ma`, then with the pressure to `brake_ma`."""
        return self._legs(x, v, pressure_ma, converter_ma, first_ma, brake_ma)[-1].end.x

    def stop(
        self, x: float, v: float, pressure_ma: float, converter_ma: float, first_ma: float, brake_ma: float
    ) -> Stop:
        """Return the same place with its derivatives."""
        legs = self._legs(x, v, pressure_ma, converter_ma, first_ma, brake_ma)
        by_x, by_v, by_p, by_w, by_u = 1.0, 0.0, 0.0, 0.0, 0.0
        for leg in reversed(legs):
            by_x, by_v, by_p, by_w, by_u = self._before(leg, by_x, by_v, by_p, by_w, by_u)
        return Stop(legs[-1].end.x, by_x, by_v, by_p, by_w, by_u)

    def current_ma(
        self,
        x: float,
        v: float,
        pressure_ma: float,
        converter_ma: float,
        target_m: float,
        brake_ma: float,
        fastest_ma: float,
    ) -> float:
        """Return the current in mA for one sample, as far as `fastest_ma`, after which the stem stops at `target_m`.

        Where even the braking current takes it too far, that one; where `fastest_ma` is not enough, that one.
        """
        s = self.slide.direction
        slowest_ma = self.drive.command_ma(pressure_ma, converter_ma, brake_ma)
        if s * (fastest_ma - slowest_ma) <= 0.0:
            return slowest_ma
        current_ma = high_ma = fastest_ma
        low_ma = slowest_ma
        for _ in range(_MOST_PASSES):
            found = self.stop(x, v, pressure_ma, converter_ma, current_ma, brake_ma)
            beyond_m = found.x - target_m
            if abs(beyond_m) < _CLOSE_M:
                break
            if s * beyond_m > 0.0:
                if current_ma == slowest_ma:
                    break
                high_ma = current_ma
            else:
                if current_ma == fastest_ma:
                    break
                low_ma = current_ma
            # by Newton's method; the braking current itself where that leads to it, the middle where it leads beyond
            newer_ma = current_ma - beyond_m / found.x_u if found.x_u else slowest_ma
            if s * (newer_ma - low_ma) <= 0.0:
                newer_ma = slowest_ma if low_ma == slowest_ma else (low_ma + high_ma) / 2.0
            elif s * (newer_ma - high_ma) >= 0.0:
                newer_ma = (low_ma + high_ma) / 2.0
            current_ma = newer_ma
        return current_ma

    def _legs(
        self, x: float, v: float, pressure_ma: float, converter_ma: float, first_ma: float, brake_ma: float
    ) -> list[_Leg]:
        """Return the pieces until the stop, with the motion over each."""
        drive, legs = self.drive, list[_Leg]()
        pieces = drive.course(pressure_ma, converter_ma, first_ma)
        if self._run(pieces, Phase.SAMPLE, x, v, legs):
            return legs
        pressure_ma, converter_ma = drive.after(pressure_ma, converter_ma, first_ma)
        for phase, pieces in braking_course(drive, pressure_ma, converter_ma, brake_ma):
            end = legs[-1].end
            if self._run(pieces, phase, end.x, end.v, legs):
                break
        return legs

    def _run(self, pieces: list[Piece], phase: Phase, x: float, v: float, legs: list[_Leg]) -> bool:
        """Add the motion over `pieces` to `legs`; return whether the stem stopped in one of them."""
        for piece in pieces:
            end = self.slide.along(piece, x, v)
            legs.append(_Leg(piece, phase, end))
            if end.stopped:
                return True
            x, v = end.x, end.v
        return False

    def _before(
        self, leg: _Leg, by_x: float, by_v: float, by_p: float, by_w: float, by_u: float
    ) -> tuple[float, float, float, float, float]:
        """Return the derivatives of the stop to the state before `leg`, from those to the state after it."""
        piece, end = leg.piece, leg.end
        x0, v0 = self.slide.driven(0.0, end)
        steady = by_x * x0 + by_v * v0
        new_x, new_v = by_x * end.x_x + by_v * end.v_x, by_x * end.x_v + by_v * end.v_v
        if piece.far_rate:
            # p and w decay at the two rates
            k = 1.0 / (1.0 - piece.near_rate / piece.far_rate)
            x_near, v_near = self.slide.driven(piece.near_rate, end)
            x_far, v_far = self.slide.driven(piece.far_rate, end)
            e_near, e_far = math.exp(-piece.near_rate * end.t), math.exp(-piece.far_rate * end.t)
            near = by_x * x_near + by_v * v_near + by_p * e_near
            far = by_x * x_far + by_v * v_far + by_p * e_far
            new_p, new_w = far, k * (near - far) + by_w * e_near
            own_u = steady + by_p - k * near + (k - 1.0) * far + by_w * (1.0 - e_near)
        elif piece.near_rate:
            e = math.exp(-piece.near_rate * end.t)
            x_near, v_near = self.slide.driven(piece.near_rate, end)
            new_p = by_x * x_near + by_v * v_near + by_p * e
            own_u, new_w = steady + by_p - new_p, 0.0
            if leg.phase is Phase.DEADBEAT:
                # the current makes up for p, so that it arrives all the same
                left = math.exp(-piece.near_rate * piece.duration_s)
                new_p -= own_u * left / (1.0 - left)
        elif piece.slope_ma_per_s:
            new_p, own_u, new_w = steady + by_p, 0.0, 0.0
            if self.drive.lags.converter_s > 0.0:
                e = math.exp(-end.t / self.drive.lags.converter_s)
                new_w, own_u = by_w * e, by_w * (1.0 - e)
        else:
            new_p, own_u, new_w = 0.0, steady + by_p, 0.0
        return new_x, new_v, new_p, new_w, by_u + (own_u if leg.phase is Phase.SAMPLE else 0.0)


@dataclass(frozen=True, slots=True)
class _Leg:
    """One piece of the way to the stop."""

    piece: Piece
    phase: Phase
    end: Slid
