"""Spring rate, static friction and lag from the pressures at which the stem was freed: recursive least squares. Pure.

Each onset is one row, the table's Γ as a regression:
    B·p̂ - F_0 = K·x + s·F_s - B·φ (τ - τ̂),    φ = ∂p̂/∂τ.
"""

from __future__ import annotations

import math

from positioner.values import dataclass


@dataclass(frozen=True, slots=True)
class OnsetRegression:
    """K (N/m), F_s (N) and the lag as a multiple of the configured one (t), with the covariance; k, f, t in names."""

    spring_n_per_m: float
    static_n: float
    lag: float
    kk: float
    kf: float
    kt: float
    ff: float
    ft: float
    tt: float

    def loosened(self, spring_n_per_m: float, static_n: float, lag: float) -> OnsetRegression:
        """Return the regression with these standard deviations of change added."""
        return OnsetRegression(
            self.spring_n_per_m,
            self.static_n,
            self.lag,
            self.kk + spring_n_per_m * spring_n_per_m,
            self.kf,
            self.kt,
            self.ff + static_n * static_n,
            self.ft,
            self.tt + lag * lag,
        )

    def with_onset(
        self, x: float, direction: float, by_lag_n: float, force_n: float, variance_n2: float
    ) -> OnsetRegression:
        """Return the regression after one row.

        x: where the stem stuck, in m. by_lag_n: how the force depends on the lag. force_n: K·x + s·F_s as it was seen
        with the present lag. variance_n2: of that force.
        """
        # q = P h with h = (x, s, -by_lag)
        a, b, c = x, direction, -by_lag_n
        qk = a * self.kk + b * self.kf + c * self.kt
        qf = a * self.kf + b * self.ff + c * self.ft
        qt = a * self.kt + b * self.ft + c * self.tt
        spread = a * qk + b * qf + c * qt + variance_n2
        error_n = force_n - (a * self.spring_n_per_m + b * self.static_n)
        k, f, t = qk / spread, qf / spread, qt / spread
        return OnsetRegression(
            self.spring_n_per_m + k * error_n,
            self.static_n + f * error_n,
            self.lag + t * error_n,
            self.kk - k * qk,
            self.kf - k * qf,
            self.kt - k * qt,
            self.ff - f * qf,
            self.ft - f * qt,
            self.tt - t * qt,
        )

    def within(self, spring_n_per_m: float, static_n: float, lag: float) -> OnsetRegression:
        """Return the regression inside the limits around these values; `lag` 0 keeps the lag at 1."""
        return OnsetRegression(
            min(max(self.spring_n_per_m, 0.7 * spring_n_per_m), 1.3 * spring_n_per_m),
            min(max(self.static_n, 0.65 * static_n), 1.45 * static_n),
            min(max(self.lag, 0.5), 1.7) if lag else 1.0,
            self.kk,
            self.kf,
            self.kt,
            self.ff,
            self.ft,
            self.tt,
        )

    def no_looser(self, kk: float, ff: float, tt: float) -> OnsetRegression:
        """Return the regression with variances of at most these; the correlations stay."""
        k, f, t = _share(self.kk, kk), _share(self.ff, ff), _share(self.tt, tt)
        return OnsetRegression(
            self.spring_n_per_m,
            self.static_n,
            self.lag,
            k * k * self.kk,
            k * f * self.kf,
            k * t * self.kt,
            f * f * self.ff,
            f * t * self.ft,
            t * t * self.tt,
        )

    def sigma_n(self, x: float, direction: float) -> float:
        """Return the standard deviation in N of the force that frees a stem at x."""
        variance = x * x * self.kk + 2.0 * direction * x * self.kf + self.ff
        return math.sqrt(max(variance, 0.0))


def _share(variance: float, most: float) -> float:
    return math.sqrt(most / variance) if variance > most else 1.0
