"""Interpretations of the paper where it is not explicit: its noise, and the units of α and β. Pure.

| noise | sensor | position and speed |
|---|---|---|
| A | 2 % of the reading, white: one draw a sample | Kalman filter (D11) |
| B | 2 % of the reading, each draw held for 10 ms | the reading, and its difference quotient |
| noise-free | no noise: the control run of A and B | the reading, and its difference quotient |

| units | α of eq. 22 | β of eq. 22 |
|---|---|---|
| SI | 5 m/s | 150 1/m (D6) |
| cm | 5 cm/s | 150 1/cm, the units of the paper's Table 2 |

Noise is held when the noise block of a simulation program has its own sample time.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from typing import TYPE_CHECKING, Any

from positioner.laws.estimator_settings import EstimationMethod

if TYPE_CHECKING:
    from collections.abc import Mapping

    from positioner.bench.scenario import Scenario

NOISE_HOLD_S = 0.01
"""How long interpretation B holds a draw of the noise."""


class NoiseKind(StrEnum):
    """An interpretation of "a random signal with a mean power of 2 %", with the estimates of position and speed."""

    FILTERED = "A"
    RAW = "B"
    FREE = "noise-free"


class Units(StrEnum):
    """Units of α = 5 and β = 150."""

    SI = "SI"
    CENTIMETRES = "cm"


@dataclass(frozen=True, slots=True, order=True)
class Interpretation:
    """One interpretation of the paper; interpretations sort as the columns of a table."""

    noise: NoiseKind
    units: Units

    def __str__(self) -> str:
        """Name of a column or of a heading."""
        return f"{self.noise}, {self.units}"


def interpretations(noises: tuple[NoiseKind, ...]) -> tuple[Interpretation, ...]:
    """Return every interpretation with one of `noises`, and the noise-free control runs."""
    return tuple(Interpretation(noise, units) for noise in (*noises, NoiseKind.FREE) for units in Units)


def interpreted_as(scenario: Scenario, noise: NoiseKind | None, units: Units | None) -> Scenario:
    """Return `scenario` with sensor and estimator of `noise`, and the bounds of `units`; None changes nothing."""
    plant, control, estimator = scenario.plant, scenario.control, scenario.estimator
    match noise:
        case NoiseKind.FILTERED:
            estimator = {**estimator, "method": str(EstimationMethod.KALMAN)}
        case NoiseKind.RAW:
            estimator = {**estimator, "method": str(EstimationMethod.RAW)}
            plant = _with(plant, "sensor", {"noise_hold_s": NOISE_HOLD_S})
        case NoiseKind.FREE:
            estimator = {**estimator, "method": str(EstimationMethod.RAW)}
            plant = _with(plant, "sensor", {"noise_of_reading": 0.0})
    if units is not None:
        in_si = units is Units.SI
        bounds = {
            "approach_span_m_per_s": 5.0 if in_si else 0.05,
            "approach_decay_per_m": 150.0 if in_si else 15000.0,
        }
        control = _with(control, "bounds", bounds)
    return replace(scenario, plant=plant, control=control, estimator=estimator)


def _with(table: Mapping[str, Any], key: str, changes: Mapping[str, Any]) -> dict[str, Any]:
    return {**table, key: {**table.get(key, {}), **changes}}
