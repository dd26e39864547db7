"""Spring rate, static and sliding friction, and lag, from onsets and slips: recursive least squares. Pure.

Each onset is one row, the table's Γ as a regression:
    B·p̂ - F_0 = K·x + s·F_s - B·φ (τ - τ̂),    φ = ∂p̂/∂τ.
Each slip is another: an error of K looks like one of F_c, so its readings show F̂_c = F_c + s·x (K - K̂).
"""

from __future__ import annotations

import math

from positioner.values import dataclass, replace


@dataclass(frozen=True, slots=True)
class OnsetRegression:
    """K (N/m), F_s (N), the lag as a multiple of the configured one (t), F_c (N), and their covariance.

    k, f, t and c in names. Onsets alone leave F_c as it is, unless it is correlated with F_s.
    """

    spring_n_per_m: float
    static_n: float
    lag: float
    sliding_n: float
    kk: float
    kf: float
    kt: float
    kc: float
    ff: float
    ft: float
    fc: float
    tt: float
    tc: float
    cc: float

    def loosened(self, spring_n_per_m: float, static_n: float, lag: float) -> OnsetRegression:
        """Return the regression with these standard deviations of change added."""
        return replace(
            self,
            kk=self.kk + spring_n_per_m * spring_n_per_m,
            ff=self.ff + static_n * static_n,
            tt=self.tt + lag * lag,
        )

    def with_onset(
        self, x: float, direction: float, by_lag_n: float, force_n: float, variance_n2: float
    ) -> OnsetRegression:
        """Return the regression after one row.

        x: where the stem stuck, in m. by_lag_n: how the force depends on the lag. force_n: K·x + s·F_s as it was seen
        with the present lag. variance_n2: of that force.
        """
        # q = P h with h = (x, s, -by_lag, 0)
        a, b, c = x, direction, -by_lag_n
        qk = a * self.kk + b * self.kf + c * self.kt
        qf = a * self.kf + b * self.ff + c * self.ft
        qt = a * self.kt + b * self.ft + c * self.tt
        qc = a * self.kc + b * self.fc + c * self.tc
        spread = a * qk + b * qf + c * qt + variance_n2
        error_n = force_n - (a * self.spring_n_per_m + b * self.static_n)
        return self._changed(qk, qf, qt, qc, error_n / spread, 1.0 / spread)

    def slip_n2(self, x: float, direction: float, scatter2: float) -> float:
        """Return the variance in N² of the F_c that a slip at x will show; scatter2: of single slips, relative."""
        wrong_n2 = x * (x * self.kk + 2.0 * direction * self.kc)
        return max(self.cc + wrong_n2, 0.0) + scatter2 * self.sliding_n * self.sliding_n

    def with_slip(
        self, x: float, direction: float, scatter2: float, found_n: float, found_n2: float
    ) -> OnsetRegression:
        """Return the regression after a slip at x that began with `slip_n2`, and showed F_c with a variance in N²."""
        a, before_n2 = direction * x, self.slip_n2(x, direction, scatter2)
        qk, qf, qt, qc = a * self.kk + self.kc, a * self.kf + self.fc, a * self.kt + self.tc, a * self.kc + self.cc
        shown = min(max(1.0 - found_n2 / before_n2, 0.0), 1.0)
        return self._changed(qk, qf, qt, qc, (found_n - self.sliding_n) / before_n2, shown / before_n2)

    def _changed(self, qk: float, qf: float, qt: float, qc: float, change: float, known: float) -> OnsetRegression:
        """Return the regression moved by q·`change`, with a covariance that is less by q·qᵀ·`known`."""
        return OnsetRegression(
            self.spring_n_per_m + qk * change,
            self.static_n + qf * change,
            self.lag + qt * change,
            self.sliding_n + qc * change,
            self.kk - known * qk * qk,
            self.kf - known * qk * qf,
            self.kt - known * qk * qt,
            self.kc - known * qk * qc,
            self.ff - known * qf * qf,
            self.ft - known * qf * qt,
            self.fc - known * qf * qc,
            self.tt - known * qt * qt,
            self.tc - known * qt * qc,
            self.cc - known * qc * qc,
        )

    def within(self, spring_n_per_m: float, static_n: float, lag: float) -> OnsetRegression:
        """Return the regression inside the limits around these values; `lag` 0 keeps the lag at 1."""
        return replace(
            self,
            spring_n_per_m=min(max(self.spring_n_per_m, 0.7 * spring_n_per_m), 1.3 * spring_n_per_m),
            static_n=min(max(self.static_n, 0.65 * static_n), 1.45 * static_n),
            lag=min(max(self.lag, 0.5), 1.7) if lag else 1.0,
        )

    def no_looser(self, kk: float, ff: float, tt: float, cc: float) -> OnsetRegression:
        """Return the regression with variances of at most these; the correlations stay."""
        k, f, t, c = _share(self.kk, kk), _share(self.ff, ff), _share(self.tt, tt), _share(self.cc, cc)
        return replace(
            self,
            kk=k * k * self.kk,
            kf=k * f * self.kf,
            kt=k * t * self.kt,
            kc=k * c * self.kc,
            ff=f * f * self.ff,
            ft=f * t * self.ft,
            fc=f * c * self.fc,
            tt=t * t * self.tt,
            tc=t * c * self.tc,
            cc=c * c * self.cc,
        )


def _share(variance: float, most: float) -> float:
    return math.sqrt(most / variance) if variance > most else 1.0
