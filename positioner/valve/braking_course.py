"""The pressure under deadbeat commands to a braking pressure, in as few pieces as its course has. Pure.

Without a converter's lag it goes at the limit of the loop for whole samples, arrives in one more, and stays. Behind a
converter it goes at the limit until w meets its aim w* = p + (p_b - p)/part, as in `Drive.aim_ma`; with that aim it
arrives with the time constant τ·part.
"""

from __future__ import annotations

import math
from enum import Enum
from typing import TYPE_CHECKING

from positioner.valve.course import Lags, Piece
from positioner.valve.motion import STOPPING_TIME_S

if TYPE_CHECKING:
    from positioner.valve.drive import Drive

_LASTING = 12.0
"""An exponential arrival counts as over after so many of its time constants."""
_HALVINGS = 40
_ROUNDING = 1e-9
"""Of a quotient of two times."""
_EQUAL_MA = 1e-9


class Phase(Enum):
    """What commands the pressure in a piece."""

    SAMPLE = 0
    """The current of the sample."""
    LIMIT = 1
    """The limit of the loop, or the braking pressure itself."""
    DEADBEAT = 2
    """The deadbeat command that arrives in this sample."""


def braking_course(
    drive: Drive, pressure_ma: float, converter_ma: float, brake_ma: float
) -> list[tuple[Phase, list[Piece]]]:
    """Return the course of the pressure under deadbeat commands to `brake_ma`, if need be beyond the loop's limits."""
    lags, phases = drive.lags, list[tuple[Phase, list[Piece]]]()
    way_ma = brake_ma - pressure_ma
    lag_s = lags.of(way_ma)
    if lag_s > 0.0 and lags.converter_s <= 0.0 and way_ma != 0.0:
        limit_ma = drive.high_ma if way_ma > 0.0 else drive.low_ma
        gap_ma = math.copysign(1.0, way_ma) * (limit_ma - pressure_ma)
        whole_s = min(_arrival_s(lags, gap_ma, abs(way_ma), lag_s), STOPPING_TIME_S)
        whole_s = math.floor(whole_s / drive.period_s + _ROUNDING) * drive.period_s
        if whole_s > 0.0:
            pieces = lags.course(pressure_ma, limit_ma, limit_ma, whole_s)
            phases.append((Phase.LIMIT, pieces))
            pressure_ma = pieces[-1].pressure_ma(pieces[-1].duration_s)
        current_ma = drive.command_ma(pressure_ma, pressure_ma, brake_ma)
        phases.append((Phase.DEADBEAT, drive.course(pressure_ma, pressure_ma, current_ma)))
    elif lag_s > 0.0 and way_ma != 0.0:
        phases += _behind_converter(drive, pressure_ma, converter_ma, drive.limited(brake_ma))
    phases.append((Phase.LIMIT, [Piece(STOPPING_TIME_S, drive.limited(brake_ma))]))
    return phases


def _arrival_s(lags: Lags, gap_ma: float, way_ma: float, lag_s: float) -> float:
    """Return how long a pressure takes for `way_ma` whose limit is `gap_ma` away; infinity if it never gets there."""
    if gap_ma <= way_ma:
        return math.inf
    slewing_s = max(gap_ma / lags.slew_ma_per_s - lag_s, 0.0)
    slewed_ma = lags.slew_ma_per_s * slewing_s if slewing_s else 0.0
    if way_ma <= slewed_ma:
        return way_ma / lags.slew_ma_per_s
    left_ma = max(gap_ma - way_ma, _EQUAL_MA)
    return slewing_s + lag_s * math.log((gap_ma - slewed_ma) / left_ma)


def _behind_converter(
    drive: Drive, pressure_ma: float, converter_ma: float, brake_ma: float
) -> list[tuple[Phase, list[Piece]]]:
    """Return the course to `brake_ma` behind a converter, but for the steady end."""
    lags, phases = drive.lags, list[tuple[Phase, list[Piece]]]()
    arriving = Lags(lags.fill_s * drive.fill_arrival, lags.vent_s * drive.vent_arrival, 0.0, lags.slew_ma_per_s)
    way_ma = brake_ma - pressure_ma
    limit_ma = drive.high_ma if drive.aim_ma(pressure_ma, brake_ma) > converter_ma else drive.low_ma
    side = 1.0 if limit_ma > converter_ma else -1.0
    longest_s = lags.converter_s * _LASTING + abs(way_ma) / lags.slew_ma_per_s + max(lags.fill_s, lags.vent_s)
    pieces = list[Piece]()
    for piece in lags.course(pressure_ma, converter_ma, limit_ma, longest_s):
        aim_ma = drive.aim_ma(piece.pressure_ma(piece.duration_s), brake_ma)
        after_ma = lags.converter_ma(converter_ma, limit_ma, piece.duration_s)
        if side * (aim_ma - after_ma) > 0.0:
            pieces.append(piece)
            converter_ma = after_ma
            continue
        low_s, high_s = 0.0, piece.duration_s
        for _ in range(_HALVINGS):
            middle_s = (low_s + high_s) / 2.0
            aim_ma = drive.aim_ma(piece.pressure_ma(middle_s), brake_ma)
            if side * (aim_ma - lags.converter_ma(converter_ma, limit_ma, middle_s)) > 0.0:
                low_s = middle_s
            else:
                high_s = middle_s
        pieces.append(piece.until(high_s))
        break
    phases.append((Phase.LIMIT, pieces))
    pressure_ma = pieces[-1].pressure_ma(pieces[-1].duration_s)
    lasting_s = _LASTING * arriving.of(brake_ma - pressure_ma) + abs(brake_ma - pressure_ma) / lags.slew_ma_per_s
    phases.append((Phase.LIMIT, arriving.course(pressure_ma, brake_ma, brake_ma, lasting_s)))
    return phases
