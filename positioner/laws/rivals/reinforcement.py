"""Constant reinforcement (Ivan and Lakshminarayanan 2009, Ind. Eng. Chem. Res. 48). Pure.

    u = u_c + a sign(Δu_c),   Δu_c the change of the controller's output since the last sample

Unlike the knocker's pulses it acts all the time, except inside the off-band.
"""

from __future__ import annotations

import math
from typing import Annotated

from annotated_types import Interval

from positioner.inputs.table import SettingsTable
from positioner.laws.rivals.pid import PidSettings  # noqa: TC001 - pydantic reads this hint at run time
from positioner.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class ReinforcementSettings(SettingsTable):
    """The `[control.constant_reinforcement]` table: the controller and what is added.

    pid: the controller's gains.
    reinforcement_ma: a, added to the current in the direction of the error.
    off_band_m: error below which nothing is added; 0 always adds.
    """

    pid: PidSettings
    reinforcement_ma: Annotated[float, Interval(ge=0.0, le=16.0)]
    off_band_m: Annotated[float, Interval(ge=0.0, le=0.1)]


@dataclass(frozen=True, slots=True)
class Reinforcement:
    """The compensator; its memory is the controller's last output in mA."""

    settings: ReinforcementSettings

    def begin(self, output_ma: float) -> float:
        """Return the output before the first cycle."""
        return output_ma

    def add(self, memory: float, output_ma: float, error_m: float, elapsed_s: float) -> tuple[float, float]:  # noqa: ARG002 - the interface's
        """Return the output to remember, and ±a in mA, 0 where the output does not change."""
        change_ma = output_ma - memory
        if change_ma == 0.0 or abs(error_m) < self.settings.off_band_m:
            return output_ma, 0.0
        return output_ma, math.copysign(self.settings.reinforcement_ma, change_ma)
