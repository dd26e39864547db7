"""The pressure that acted on the stem between two readings, in mA: measured, or by the actuator's model. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.values import dataclass
from positioner.valve.pressure import pressure_model

if TYPE_CHECKING:
    from positioner.valve.actuator import ActuatorParameters
    from positioner.valve.pressure import PressureModel, PressureState


@dataclass(frozen=True, slots=True)
class PressureSettings:
    """K_p and the actuator; `model` is None where the pressure is the current at once."""

    gain_pa_per_ma: float
    model: PressureModel | None

    @classmethod
    def of(cls, gain_pa_per_ma: float, actuator: ActuatorParameters, period_s: float) -> PressureSettings:
        """Return the settings of a configured actuator."""
        return cls(gain_pa_per_ma, None if actuator.is_immediate else pressure_model(actuator, period_s))


@dataclass(slots=True)
class Pressure:
    """The newest measured pressure, and the pressure by the actuator's model; `acted_ma` changes them in place."""

    measured_ma: float | None = None
    modelled: PressureState | None = None


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
    model = settings.model
    if model is None:
        return current_ma
    modelled = state.modelled or model.at_rest(current_ma)
    total_ma = 0.0
    for _ in range(periods):
        before_ma = modelled.pressure_ma
        modelled = model.after(modelled, current_ma)
        total_ma += 0.5 * (before_ma + modelled.pressure_ma)
    state.modelled = modelled
    return total_ma / periods
