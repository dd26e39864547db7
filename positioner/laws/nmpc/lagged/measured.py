"""The measured pressure: what it says of the pressure now and of the two lags, weighted by its noise. Pure.

The pressure p̂ of the `Pipeline` follows the commands. Its error comes from wrong lags, and from all that the model does
not know. A Kalman filter carries the covariance of p, of both lags as multiples a of the configured ones, and of the
sensor's offset o, which is calibrated to the currents: at rest the pressure is its current. A reading is y = p + o, and
    p⁺ = p + Δ,    ∂p⁺/∂p = e^(-r),    ∂p⁺/∂a = -Δ r/(e^r - 1)/a,    r = T_s/τ,
with the change Δ of a sample, and ρ·Δ as its unknown part. A reading that exceeds its own σ too far is not used; after
some of them in a row the sensor is disregarded, until it agrees again with a pressure that moves.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.laws.nmpc.lagged.pressure_noise import PressureNoise
from positioner.laws.nmpc.lagged.supply import NO_RISE, Supply
from positioner.values import dataclass, replace

if TYPE_CHECKING:
    from positioner.laws.nmpc.lagged.drive import Drive

_UNKNOWN = 0.05
"""ρ: the part of a change that the lags do not explain, as a standard deviation."""
_WANDER = 1e-6
"""Variance that a lag's multiple gains for each mA of change."""
_OFFSET2 = 0.09
"""Variance of the offset in mA² before the first reading."""
_OFFSET_PER_S, _OFFSET_PER_MA = 4e-4, 2e-4
"""Variance in mA² that the offset gains in a second, and for each mA of change, since the gain may be wrong, too."""
_LEAST_LAG, _MOST_LAG = 0.5, 1.7
_MOST_OFFSET_MA = 1.0
_GATE = 6.0
_REFUSED, _AGREED = 25, 200
"""Readings in a row that end trust in the sensor; readings of a moving pressure that restore it."""
_MOVING_MA = 0.01
"""A pressure that changes by more in a sample moves."""
_LONGEST_R = 30.0


@dataclass(frozen=True, slots=True)
class MeasuredPressure:
    """What the readings have taught.

    fill, vent: the lags, as multiples of the configured ones; offset_ma: of the sensor. pp to oo: their covariance,
    with p in mA. moved_ma: the change in the last sample. refused, agreed: readings in a row; trusted: whether they
    count. noise: of the sensor. supply: the rise of the pressure.
    """

    fill: float
    vent: float
    offset_ma: float
    pp: float
    pf: float
    pv: float
    po: float
    ff: float
    fv: float
    fo: float
    vv: float
    vo: float
    oo: float
    moved_ma: float = 0.0
    refused: int = 0
    agreed: int = 0
    trusted: bool = True
    noise: PressureNoise = PressureNoise()
    supply: Supply = NO_RISE

    @property
    def is_used(self) -> bool:
        """Whether the readings count."""
        return self.trusted and self.noise.is_known

    def later(self, drive: Drive, before_ma: float, after_ma: float) -> MeasuredPressure:
        """Return the filter one sample later, in which the model's pressure went from `before_ma` to `after_ma`."""
        change_ma = after_ma - before_ma
        fills = change_ma > 0.0
        lag_s = drive.fill_s if fills else drive.vent_s
        left, slope = 0.0, 0.0
        if drive.is_slewing(change_ma):
            left = 1.0
        elif lag_s > 0.0:
            r = min(drive.period_s / lag_s, _LONGEST_R)
            left = math.exp(-r)
            slope = -change_ma * r / math.expm1(r) / (self.fill if fills else self.vent)
        unknown_ma, wander = _UNKNOWN * change_ma, _WANDER * abs(change_ma)
        ff, vv = (self.ff + wander, self.vv) if fills else (self.ff, self.vv + wander)
        pa, aa, ao = (self.pf, ff, self.fo) if fills else (self.pv, vv, self.vo)
        return MeasuredPressure(
            self.fill,
            self.vent,
            self.offset_ma,
            left * (left * self.pp + 2.0 * slope * pa) + slope * slope * aa + unknown_ma * unknown_ma,
            left * self.pf + slope * (ff if fills else self.fv),
            left * self.pv + slope * (self.fv if fills else vv),
            left * self.po + slope * ao,
            ff,
            self.fv,
            self.fo,
            vv,
            self.vo,
            self.oo + _OFFSET_PER_S * drive.period_s + _OFFSET_PER_MA * abs(change_ma),
            change_ma,
            self.refused,
            self.agreed,
            self.trusted,
            self.noise,
            self.supply,
        )

    def corrected(
        self, pressure_ma: float, reading_ma: float, variance_ma2: float, patience: float
    ) -> tuple[MeasuredPressure, float]:
        """Return the filter after a reading of p̂ = `pressure_ma`, and the corrected pressure in mA.

        So many readings more than usual are to be refused in a row, before the sensor is: its `patience`.
        """
        innovation_ma = reading_ma - self.offset_ma - pressure_ma
        qp, qf, qv, qo = self.pp + self.po, self.pf + self.fo, self.pv + self.vo, self.po + self.oo
        spread = qp + qo + variance_ma2
        if innovation_ma * innovation_ma > _GATE * _GATE * (spread + _ROUNDING_MA2):
            refused = self.refused + 1
            return replace(
                self, refused=refused, agreed=0, trusted=self.trusted and refused < _REFUSED + patience
            ), pressure_ma
        if not self.trusted:
            agreed = self.agreed + 1 if abs(self.moved_ma) > _MOVING_MA else self.agreed
            return replace(self, refused=0, agreed=agreed, trusted=agreed >= _AGREED), pressure_ma
        kp, kf, kv, ko = qp / spread, qf / spread, qv / spread, qo / spread
        after = MeasuredPressure(
            min(max(self.fill + kf * innovation_ma, _LEAST_LAG), _MOST_LAG),
            min(max(self.vent + kv * innovation_ma, _LEAST_LAG), _MOST_LAG),
            min(max(self.offset_ma + ko * innovation_ma, -_MOST_OFFSET_MA), _MOST_OFFSET_MA),
            self.pp - kp * qp,
            self.pf - kp * qf,
            self.pv - kp * qv,
            self.po - kp * qo,
            self.ff - kf * qf,
            self.fv - kf * qv,
            self.fo - kf * qo,
            self.vv - kv * qv,
            self.vo - kv * qo,
            self.oo - ko * qo,
            self.moved_ma,
            0,
            0,
            trusted=True,
            noise=self.noise,
            supply=self.supply,
        )
        return after, pressure_ma + kp * innovation_ma

    def with_noise(self, noise: PressureNoise, doubt_ma: float) -> MeasuredPressure:
        """Return the filter before readings count, while the pressure is known to `doubt_ma`."""
        return replace(self, noise=noise, pp=doubt_ma * doubt_ma, pf=0.0, pv=0.0, po=0.0)

    def with_unknown_fill(self, doubt: float) -> MeasuredPressure:
        """Return the filter that knows nothing of the fill lag but that it is within `doubt` of the configured one."""
        return replace(self, fill=1.0, ff=doubt * doubt, pf=0.0, fv=0.0, fo=0.0)


def unmeasured(lag2: float, fill: float = 1.0, vent: float = 1.0) -> MeasuredPressure:
    """Return the filter before the first reading, with these multiples of the configured lags and their variance."""
    return MeasuredPressure(fill, vent, 0.0, 0.0, 0.0, 0.0, 0.0, lag2, 0.0, 0.0, lag2, 0.0, _OFFSET2)


_ROUNDING_MA2 = 1e-6
"""Of a pressure in its frame, and of a current: 1 µA squared, with some spare."""
