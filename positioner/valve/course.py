"""The course of the pressure under a steady current, in pieces that have a closed form. Pure.

ẇ = (u - w)/τ_c and ṗ = (w - p)/τ within ± the slew limit, τ = fill or vent by the sign of w - p; p and w in mA. Each
piece ends where the slew limit begins or ends to act, or where w crosses p:
    p(t) = steady + slope t + near e^(-near_rate t) + far e^(-far_rate t).
Without a lag the pressure is the current, in one piece. Two equal lags are taken a little apart.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.values import dataclass

if TYPE_CHECKING:
    from collections.abc import Callable

    from positioner.valve.actuator import ActuatorParameters

_SHORTEST_LAG_S = 1e-6
"""Takes the place of no lag where a converter or a slew limit is before it."""
_ALIKE = 1e-5
"""Lags whose rates differ by less than this part are taken apart by it."""
_EQUAL_MA = 1e-9
"""Converter and pressure count as equal while they differ by less."""
_EDGE = 1e-9
"""The slew limit counts as reached while the gap differs from it by less than this part."""
_HALVINGS = 50
_MOST_PIECES = 8
"""In one course; the rest of it is one piece, in which neither the limit nor the other lag begins to act."""


@dataclass(frozen=True, slots=True)
class Piece:
    """A piece of `duration_s`: the pressure in mA as a function of the time in it, rates in 1/s, slope in mA/s."""

    duration_s: float
    steady_ma: float
    slope_ma_per_s: float = 0.0
    near_ma: float = 0.0
    near_rate: float = 0.0
    far_ma: float = 0.0
    far_rate: float = 0.0

    def pressure_ma(self, t: float) -> float:
        """Return the pressure at the time `t` in s."""
        pressure_ma = self.steady_ma + self.slope_ma_per_s * t
        if self.near_ma:
            pressure_ma += self.near_ma * math.exp(-self.near_rate * t)
        if self.far_ma:
            pressure_ma += self.far_ma * math.exp(-self.far_rate * t)
        return pressure_ma

    def until(self, duration_s: float) -> Piece:
        """Return the same piece with another duration."""
        return Piece(
            duration_s,
            self.steady_ma,
            self.slope_ma_per_s,
            self.near_ma,
            self.near_rate,
            self.far_ma,
            self.far_rate,
        )


@dataclass(frozen=True, slots=True)
class Lags:
    """Fill and vent lag τ and the converter's τ_c in s, 0 for none; the slew limit in mA/s, infinity for none."""

    fill_s: float
    vent_s: float
    converter_s: float
    slew_ma_per_s: float

    def of(self, gap_ma: float) -> float:
        """Return τ in s for a pressure that is `gap_ma` below what it follows."""
        return self.fill_s if gap_ma > 0.0 else self.vent_s

    def converter_ma(self, converter_ma: float, current_ma: float, t: float) -> float:
        """Return the output of the converter after `t` seconds under `current_ma`."""
        if self.converter_s <= 0.0:
            return current_ma
        return current_ma + (converter_ma - current_ma) * math.exp(-t / self.converter_s)

    def course(self, pressure_ma: float, converter_ma: float, current_ma: float, duration_s: float) -> list[Piece]:
        """Return the pieces of the pressure from `pressure_ma` and the converter's output under a steady current."""
        if self.converter_s > 0.0:
            return self._behind_converter(pressure_ma, converter_ma, current_ma, duration_s)
        gap_ma = current_ma - pressure_ma
        lag_s = self.of(gap_ma)
        if lag_s <= 0.0:
            return [Piece(duration_s, current_ma)]
        slewing_s = abs(gap_ma) / self.slew_ma_per_s - lag_s
        if slewing_s <= 0.0:
            return [Piece(duration_s, current_ma, 0.0, -gap_ma, 1.0 / lag_s)]
        slope = math.copysign(self.slew_ma_per_s, gap_ma)
        slewing = Piece(min(slewing_s, duration_s), pressure_ma, slope)
        if slewing_s >= duration_s:
            return [slewing]
        return [slewing, Piece(duration_s - slewing_s, current_ma, 0.0, -slope * lag_s, 1.0 / lag_s)]

    def _behind_converter(
        self, pressure_ma: float, converter_ma: float, current_ma: float, left_s: float
    ) -> list[Piece]:
        pieces = list[Piece]()
        while left_s > 0.0:
            gap_ma, moving_ma = converter_ma - pressure_ma, converter_ma - current_ma
            # where the two cross, the side is that to which the converter moves
            side = math.copysign(1.0, gap_ma if abs(gap_ma) > _EQUAL_MA else -moving_ma)
            lag_s = self.of(side)
            widest_ma = self.slew_ma_per_s * lag_s
            grows = -side * moving_ma > self.slew_ma_per_s * self.converter_s
            if side * gap_ma > widest_ma * (1.0 - _EDGE if grows else 1.0 + _EDGE):
                piece = Piece(left_s, pressure_ma, side * self.slew_ma_per_s)
            else:
                piece = _two_lags(pressure_ma, current_ma, moving_ma, lag_s, self.converter_s, left_s)
            if len(pieces) + 1 < _MOST_PIECES:
                piece = piece.until(self._end_s(piece, gap_ma, current_ma, moving_ma, side))
            pieces.append(piece)
            left_s -= piece.duration_s
            pressure_ma = piece.pressure_ma(piece.duration_s)
            converter_ma = self.converter_ma(converter_ma, current_ma, piece.duration_s)
        return pieces

    def _end_s(self, piece: Piece, gap_ma: float, current_ma: float, moving_ma: float, side: float) -> float:
        """Return when the piece ends: where the slew limit begins or ends to act, or w crosses p."""
        end_s, rate = piece.duration_s, piece.near_rate or 1.0 / self.converter_s
        widest_ma = self.slew_ma_per_s * self.of(side)

        def excess_ma(t: float) -> float:
            return side * (current_ma + moving_ma * math.exp(-rate * t) - piece.pressure_ma(t)) - widest_ma

        if piece.slope_ma_per_s:
            return _crossing_s(excess_ma, 1.0, end_s) if excess_ma(end_s) < 0.0 else end_s
        # w - p = own e^(-rate t) - far e^(-far_rate t)
        own_ma, apart = moving_ma - piece.near_ma, piece.far_rate - rate
        if own_ma == 0.0:
            return end_s
        ratio = piece.far_ma / own_ma
        if (self.fill_s != self.vent_s or self.slew_ma_per_s < math.inf) and ratio > 0.0 and abs(gap_ma) > _EQUAL_MA:
            crossing_s = math.log(ratio) / apart
            end_s = crossing_s if 0.0 < crossing_s < end_s else end_s
        if self.slew_ma_per_s < math.inf:
            ratio *= piece.far_rate / rate
            widest_s = math.log(ratio) / apart if ratio > 0.0 else 0.0
            for each_s in (widest_s, end_s):
                if 0.0 < each_s <= end_s and excess_ma(each_s) > widest_ma * _EDGE:
                    return _crossing_s(excess_ma, -1.0, each_s)
        return end_s


def _two_lags(
    pressure_ma: float, current_ma: float, moving_ma: float, lag_s: float, converter_s: float, duration_s: float
) -> Piece:
    """Return the course of a pressure that follows the converter, which is `moving_ma` from its current."""
    if abs(lag_s - converter_s) < _ALIKE * converter_s:
        middle_s = (lag_s + converter_s) / 2.0
        lag_s, converter_s = middle_s * (1.0 - _ALIKE / 2.0), middle_s * (1.0 + _ALIKE / 2.0)
    near_ma = moving_ma * converter_s / (converter_s - lag_s)
    far_ma = pressure_ma - current_ma - near_ma
    return Piece(duration_s, current_ma, 0.0, near_ma, 1.0 / converter_s, far_ma, 1.0 / lag_s)


def _crossing_s(excess_ma: Callable[[float], float], sign: float, end_s: float) -> float:
    """Return where `sign` times a function, positive before, crosses 0 in 0 to `end_s`: by bisection."""
    low_s, high_s = 0.0, end_s
    for _ in range(_HALVINGS):
        middle_s = (low_s + high_s) / 2.0
        if sign * excess_ma(middle_s) > 0.0:
            low_s = middle_s
        else:
            high_s = middle_s
    return high_s


def lags_of(actuator: ActuatorParameters, scale: float = 1.0) -> Lags:
    """Return the lags of `actuator`, with fill and vent `scale` times as long as configured."""
    is_limited = actuator.slew_ma_per_s > 0.0
    shortest_s = _SHORTEST_LAG_S if is_limited or actuator.converter_time_constant_s > 0.0 else 0.0
    return Lags(
        max(actuator.fill_time_constant_s * scale, shortest_s),
        max(actuator.vent_time_constant_s * scale, shortest_s),
        actuator.converter_time_constant_s,
        actuator.slew_ma_per_s if is_limited else math.inf,
    )
