"""The parameters of the position sensor, with their limits; SI units. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated

from annotated_types import Interval

from positioner.inputs.table import SettingsTable


class NoiseShape(StrEnum):
    """The distribution of a value of the sensor's noise."""

    GAUSSIAN = "gaussian"
    UNIFORM = "uniform"


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorSettings(SettingsTable):
    """Position sensor: backlash of its linkage, its lag, noise, then quantisation."""

    backlash_m: Annotated[float, Interval(ge=0.0, le=0.1)] = 0.0
    """Full width of the play between stem and sensor."""
    time_constant_s: Annotated[float, Interval(ge=0.0, le=60.0)] = 0.0
    """First-order lag of the reading."""
    zero_m: Annotated[float, Interval(ge=-0.1, le=0.1)] = 0.0
    """Shift of the zero: added to the reading."""
    noise_of_reading: Annotated[float, Interval(ge=0.0, le=1.0)] = 0.0
    """Standard deviation as a fraction of the reading; the paper's "2 %" is 0.02."""
    noise_of_span: Annotated[float, Interval(ge=0.0, le=1.0)] = 0.0
    """Standard deviation as a fraction of the span; the variances of the two add up."""
    noise_hold_s: Annotated[float, Interval(ge=0.0, le=60.0)] = 0.0
    """Duration of one noise value; 0 is white noise, a new value for each sample."""
    noise_correlation_s: Annotated[float, Interval(ge=0.0, le=60.0)] = 0.0
    """Time constant of noise in which each value follows from the one before, AR(1); 0 is white noise."""
    noise_shape: NoiseShape = NoiseShape.GAUSSIAN
    """"gaussian", or "uniform" with the same standard deviation."""
    resolution_m: Annotated[float, Interval(ge=0.0, le=0.01)] = 0.0
    """Step of the quantisation; 0 is none."""
    reports_pressure: bool = False
    """Whether the plant has a pressure sensor, and sends ACTUATOR_STATE."""
    pressure_noise: Annotated[float, Interval(ge=0.0, le=1.0)] = 0.0
    """Standard deviation of its white noise as a fraction of the reading."""

    def __post_init__(self) -> None:
        """Check that the noise is of one kind.

        Raises:
            ValueError: it is both held and correlated.
        """
        if self.noise_hold_s > 0.0 and self.noise_correlation_s > 0.0:
            raise ValueError("noise_hold_s and noise_correlation_s exclude each other: leave one of them 0")
