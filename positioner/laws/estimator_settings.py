"""The `[estimator]` table of a configuration, which every law with a model reads. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated

from annotated_types import Interval

from positioner.inputs.table import SettingsTable

if TYPE_CHECKING:
    from positioner.valve.parameters import ValveParameters

_NOISE_FLOOR_M = 1e-6


class EstimationMethod(StrEnum):
    """How a law computes position and speed from the readings."""

    KALMAN = "kalman"
    """The Kalman filter with stick logic (D11)."""
    RAW = "raw"
    """Readings and their differences, as in the paper; useful only for readings without noise."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EstimatorSettings(SettingsTable):
    """The `[estimator]` table of a configuration.

    method: how the paper's law computes position and speed: "kalman", or "raw", readings and their differences.
    noise_of_reading, noise_of_span: σ of the position sensor, as parts of the reading and of the span (0.02 is 2 %).
    force_noise_n: σ of a force that the model does not know, white per sample, while sliding.
    slip_threshold_sigma: smoothed innovation, in its own σ, above which a stem that should stick must have slipped.
    slip_smoothing: weight of the newest innovation in that smoothing.
    """

    method: EstimationMethod = EstimationMethod.KALMAN
    noise_of_reading: Annotated[float, Interval(ge=0.0, le=0.5)] = 0.02
    noise_of_span: Annotated[float, Interval(ge=0.0, le=0.5)] = 0.0
    force_noise_n: Annotated[float, Interval(ge=0.0, le=1e5)] = 400.0
    slip_threshold_sigma: Annotated[float, Interval(ge=2.0, le=20.0)] = 4.5
    slip_smoothing: Annotated[float, Interval(gt=0.0, le=1.0)] = 0.1


def measurement_sigma_m(settings: EstimatorSettings, valve: ValveParameters, position_m: float) -> float:
    """Return σ of one position reading in m, at least 1 µm."""
    own = settings.noise_of_reading * abs(position_m) + settings.noise_of_span * valve.span_m
    return max(own, _NOISE_FLOOR_M)
