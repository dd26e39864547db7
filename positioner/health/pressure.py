"""The pressure that acted on the stem between two readings, in mA: measured, or by the actuator's model. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.laws.nmpc.lagged.drive import Drive, drive_of
from positioner.laws.nmpc.lagged.pipeline import Pipeline, pipeline_at
from positioner.values import dataclass

if TYPE_CHECKING:
    from positioner.valve.actuator import ActuatorParameters

_HIGHEST_MA = 1e3


@dataclass(frozen=True, slots=True)
class PressureSettings:
    """K_p, dead time and lags of the actuator; `drive` is None where the pressure is the current at once."""

    gain_pa_per_ma: float
    dead_time_s: float
    period_s: float
    drive: Drive | None

    @classmethod
    def of(cls, gain_pa_per_ma: float, actuator: ActuatorParameters, period_s: float) -> PressureSettings:
        """Return the settings of a configured actuator."""
        drive = None if actuator.is_immediate else drive_of(actuator, period_s, 0.0, _HIGHEST_MA)
        return cls(gain_pa_per_ma, actuator.dead_time_s, period_s, drive)


@dataclass(slots=True)
class Pressure:
    """The newest measured pressure, and the actuator's model; `acted_ma` changes them in place."""

    measured_ma: float | None = None
    pipeline: Pipeline | None = None


def acted_ma(
    settings: PressureSettings, state: Pressure, current_ma: float, pressure_pa: float | None, periods: int
) -> float:
    """Return the mean pressure in mA over the last `periods`, under `current_ma`; without lag it is the current.

    pressure_pa: what a sensor has measured at the end of them. It holds for spring and friction whatever supply and
    I/P converter do.
    """
    if pressure_pa is not None:
        now_ma = pressure_pa / settings.gain_pa_per_ma
        before_ma = now_ma if state.measured_ma is None else state.measured_ma
        state.measured_ma = now_ma
        return 0.5 * (before_ma + now_ma)
    if settings.drive is None:
        return current_ma
    pipeline = state.pipeline
    if pipeline is None:
        pipeline = pipeline_at(current_ma, 0.0, settings.dead_time_s, settings.period_s)
    total_ma = 0.0
    for _ in range(periods):
        before_ma = pipeline.pressure_ma
        pipeline = pipeline.after(settings.drive, current_ma)
        total_ma += 0.5 * (before_ma + pipeline.pressure_ma)
    state.pipeline = pipeline
    return total_ma / periods
