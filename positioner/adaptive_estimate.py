"""Position, speed, spring rate and friction of the stem: an extended Kalman filter with the stop inside. Pure.

While the stem slides, the filter has four states. Its covariance goes through the flow of `adaptive_slide`, stop and
all, so that the error of a landing corrects K and F. While the stem rests nothing moves: the filter is a plain average
of the position, and K and F follow it along the one line that the covariance leaves them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar

import numpy as np
from annotated_types import Interval

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from positioner.adaptive_slide import Slider


@dataclass(frozen=True, slots=True, kw_only=True)
class AdaptationSettings:
    """The `[control.nmpc.adaptation]` table of a configuration; σ as fractions of the nominal K_m and F_c.

    spring_sigma, friction_sigma: how far the configured values may be off.
    friction_per_move, friction_per_m: how friction wanders from move to move, and per metre.
    force_noise_n: force that the model does not know, white per sample, while sliding.
    landing_noise_m: error of a landing that none of the states explains.
    spring_low, spring_high, friction_low, friction_high: limits of the estimates, relative to nominal.
    """

    __pydantic_config__: ClassVar = {"extra": "forbid", "allow_inf_nan": False}

    spring_sigma: Annotated[float, Interval(ge=0.0, le=1.0)] = 0.12
    friction_sigma: Annotated[float, Interval(ge=0.0, le=1.0)] = 0.12
    friction_per_move: Annotated[float, Interval(ge=0.0, le=1.0)] = 0.05
    friction_per_m: Annotated[float, Interval(ge=0.0, le=100.0)] = 0.3
    force_noise_n: Annotated[float, Interval(ge=0.0, le=1e5)] = 60.0
    landing_noise_m: Annotated[float, Interval(ge=0.0, le=0.01)] = 5e-5
    spring_low: Annotated[float, Interval(gt=0.0, le=1.0)] = 0.6
    spring_high: Annotated[float, Interval(ge=1.0, le=10.0)] = 1.6
    friction_low: Annotated[float, Interval(gt=0.0, le=1.0)] = 0.4
    friction_high: Annotated[float, Interval(ge=1.0, le=10.0)] = 2.0


@dataclass(frozen=True, slots=True)
class Sliding:
    """The estimate while the stem slides: x (m), v (m/s), K (N/m), F (N), and their covariance (4, 4), never written.

    `direction` is that of the move (±1), `stopped` whether friction has ended it.
    """

    x: float
    v: float
    K: float
    F: float
    covariance: NDArray[np.float64]
    direction: float
    stopped: bool = False


@dataclass(frozen=True, slots=True)
class Resting:
    """The estimate while the stem rests at x (m): its variance (m²), and K and F as they follow x.

    spring_slope, friction_slope: dK/dx (N/m²) and dF/dx (N/m) of the regression on x; `anchor` is the estimate that
    came to rest; `readings` how many have been averaged since.
    """

    x: float
    variance_m2: float
    anchor: Sliding
    spring_slope: float
    friction_slope: float
    readings: int = 0

    @property
    def K(self) -> float:
        """Spring rate in N/m."""
        return self.anchor.K + self.spring_slope * (self.x - self.anchor.x)

    @property
    def F(self) -> float:
        """Coulomb friction in N."""
        return self.anchor.F + self.friction_slope * (self.x - self.anchor.x)

    @property
    def sigma_m(self) -> float:
        """Standard deviation of x in m."""
        return math.sqrt(self.variance_m2)


@dataclass(frozen=True, slots=True)
class AdaptiveFilter:
    """The filter of one valve: its motion, its limits and what it takes as unknown."""

    settings: AdaptationSettings
    slider: Slider
    nominal_spring_n_per_m: float
    nominal_friction_n: float

    def first(self, measured_m: float, sigma_m: float) -> Resting:
        """Return the estimate of a stem that rests where it was first measured, K and F being nominal."""
        return self.informed(
            measured_m,
            sigma_m * sigma_m,
            (self.nominal_spring_n_per_m, self.nominal_friction_n),
            (
                self.settings.spring_sigma * self.nominal_spring_n_per_m,
                self.settings.friction_sigma * self.nominal_friction_n,
            ),
        )

    def informed(
        self, x: float, variance_m2: float, values: tuple[float, float], sigmas: tuple[float, float]
    ) -> Resting:
        """Return the estimate of a stem at rest at x, with `values` and `sigmas` of K (N/m) and F (N)."""
        K, F = self._limited(*values)
        covariance = np.diag([variance_m2, 0.0, sigmas[0] ** 2, sigmas[1] ** 2])
        return self.rest(Sliding(x, 0.0, K, F, covariance, 1.0, True))

    def depart(self, rest: Resting, direction: float) -> Sliding:
        """Return the estimate at the start of a move: what the average taught, and friction a little less certain."""
        anchor = rest.anchor
        covariance = anchor.covariance.copy()
        whole = covariance[0, 0]
        if whole > 0.0:
            line = covariance[0] / whole
            covariance -= np.outer(line, line) * (whole - rest.variance_m2)
        covariance[1, :] = covariance[:, 1] = 0.0
        covariance[3, 3] += (self.settings.friction_per_move * self.nominal_friction_n) ** 2
        K, F = self._limited(rest.K, rest.F)
        return Sliding(rest.x, 0.0, K, F, covariance, direction)

    def advance(self, state: Sliding, current_ma: float, duration_s: float) -> Sliding:
        """Return the prediction after `duration_s` under `current_ma`; a stop inside is part of it."""
        slider, s = self.slider, state.direction
        q = slider.push_n(current_ma, s, state.F)
        flow = slider.flow(state.x, state.v, q, state.K, s, duration_s)
        transition = np.array(
            [
                [flow.dx_dx, flow.dx_dv, flow.dx_dk, -s * flow.dx_dq],
                [flow.dv_dx, flow.dv_dv, flow.dv_dk, -s * flow.dv_dq],
                [0.0, 0.0, 1.0, 0.0],
                [0.0, 0.0, 0.0, 1.0],
            ]
        )
        covariance = transition @ state.covariance @ transition.T
        if not flow.stopped:
            covariance[1, 1] += (self.settings.force_noise_n / slider.mass_kg * duration_s) ** 2
        wander = self.settings.friction_per_m * self.nominal_friction_n
        covariance[3, 3] += wander * wander * abs(flow.x - state.x)
        return Sliding(flow.x, flow.v, state.K, state.F, covariance, s, flow.stopped)

    def correct(self, state: Sliding, measured_m: float, variance_m2: float) -> Sliding:
        """Return the estimate after a reading with the variance `variance_m2`; friction forbids a change of sign."""
        column = state.covariance[:, 0]
        gain = column / (column[0] + variance_m2)
        covariance = state.covariance - np.outer(gain, column)
        dx, dv, dk, df = (gain * (measured_m - state.x)).tolist()
        K, F = self._limited(state.K + dk, state.F + df)
        v = 0.0 if state.stopped else state.v + dv
        stopped = state.stopped or (state.v != 0.0 and v * state.direction <= 0.0)
        return Sliding(state.x + dx, 0.0 if stopped else v, K, F, covariance, state.direction, stopped)

    def rest(self, state: Sliding) -> Resting:
        """Return the estimate of a stem that has come to rest, a little less certain of where."""
        covariance = state.covariance.copy()
        covariance[1, :] = covariance[:, 1] = 0.0
        covariance[0, 0] += self.settings.landing_noise_m**2
        whole = float(covariance[0, 0])
        spring, friction = float(covariance[0, 2]) / whole, float(covariance[0, 3]) / whole
        anchor = Sliding(state.x, 0.0, state.K, state.F, covariance, state.direction, True)
        return Resting(state.x, whole, anchor, spring, friction)

    def _limited(self, K: float, F: float) -> tuple[float, float]:
        """Return K and F inside their limits."""
        own, spring, friction = self.settings, self.nominal_spring_n_per_m, self.nominal_friction_n
        return (
            min(max(K, own.spring_low * spring), own.spring_high * spring),
            min(max(F, own.friction_low * friction), own.friction_high * friction),
        )


def average(rest: Resting, measured_m: float, variance_m2: float) -> Resting:
    """Return the estimate after one more reading of a resting stem."""
    gain = rest.variance_m2 / (rest.variance_m2 + variance_m2)
    return Resting(
        rest.x + gain * (measured_m - rest.x),
        (1.0 - gain) * rest.variance_m2,
        rest.anchor,
        rest.spring_slope,
        rest.friction_slope,
        rest.readings + 1,
    )
