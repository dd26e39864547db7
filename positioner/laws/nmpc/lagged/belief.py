"""What the law has learned of the valve, and how a landing corrects it. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.values import dataclass, replace

if TYPE_CHECKING:
    from positioner.laws.nmpc.lagged.regression import OnsetRegression


@dataclass(frozen=True, slots=True)
class LandingBiases:
    """How far beside their aim moves end, in m in the direction of the move: opening and closing, near and far."""

    opening_near: float = 0.0
    opening_far: float = 0.0
    closing_near: float = 0.0
    closing_far: float = 0.0

    def of(self, direction: float, *, near: bool) -> float:
        """Return the bias of one kind of move."""
        if direction > 0.0:
            return self.opening_near if near else self.opening_far
        return self.closing_near if near else self.closing_far

    def changed(self, direction: float, change_m: float, most_m: float, *, near: bool) -> LandingBiases:
        """Return the biases after one of them has changed, within ±`most_m`."""
        value = min(max(self.of(direction, near=near) + change_m, -most_m), most_m)
        if direction > 0.0:
            return replace(self, opening_near=value) if near else replace(self, opening_far=value)
        return replace(self, closing_near=value) if near else replace(self, closing_far=value)


@dataclass(frozen=True, slots=True)
class Belief:
    """The learned valve.

    onsets: K, F_s, F_c and the lag. scatter2: of the F_c of single slips, as the square of a part of it. doubt: the
    relative error to expect of F_s from one onset to the next. seen: onsets learned since one was wrong. biases: of the
    landings.
    """

    onsets: OnsetRegression
    scatter2: float
    doubt: float
    seen: int
    biases: LandingBiases

    @property
    def sliding_n(self) -> float:
        """The mean of F_c in N."""
        return self.onsets.sliding_n
