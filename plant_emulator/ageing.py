"""Static friction that grows while the stem rests: soon after a stop, and by each decade of time. Pure.

    F_s(t) = F_s·[1 + c·(1 - e^(-t/τ_c)) + g·log₁₀(1 + t/1 s)]

t is the time of rest since the stem last left the zero-speed band: moving renews the contact.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.values import dataclass

if TYPE_CHECKING:
    from plant_emulator.parameters import PackingSettings

_PER_DECADE = 1.0 / math.log(10.0)
_FIRST_S = 1.0


def growth(settings: PackingSettings, rested_s: float) -> float:
    """Return the part of F_s by which it has grown after `rested_s` of rest."""
    crept = settings.creep_fraction * -math.expm1(-rested_s / settings.creep_time_constant_s)
    return crept + settings.growth_per_decade * _PER_DECADE * math.log1p(rested_s / _FIRST_S)


@dataclass(frozen=True, slots=True)
class Ageing:
    """The growth of F_s in a rest that has lasted `rested_s` already; fresh_n is F_s just after a motion."""

    settings: PackingSettings
    fresh_n: float
    rested_s: float

    def more_n(self, time_s: float) -> float:
        """Return by how much F_s grows in the next `time_s`, in N."""
        return self.fresh_n * (growth(self.settings, self.rested_s + time_s) - growth(self.settings, self.rested_s))

    def slope(self, time_s: float) -> float:
        """Return the rate of the growth in N/s, `time_s` from now."""
        creeping, growing = self._slopes(time_s)
        return creeping + growing

    def bend_bound(self, time_s: float) -> float:
        """Return an upper bound in N/s² of the size of the second derivative, from `time_s` on."""
        creeping, growing = self._slopes(time_s)
        return creeping / self.settings.creep_time_constant_s + growing / (_FIRST_S + self.rested_s + time_s)

    def _slopes(self, time_s: float) -> tuple[float, float]:
        s, t = self.settings, self.rested_s + time_s
        creeping = self.fresh_n * s.creep_fraction / s.creep_time_constant_s * math.exp(-t / s.creep_time_constant_s)
        return creeping, self.fresh_n * s.growth_per_decade * _PER_DECADE / (_FIRST_S + t)
