"""What each method answers: its index, its limits, and its verdict. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass

from positioner.diagnostics.verdict import Verdict


@dataclass(frozen=True, slots=True)
class Answer:
    """The answer of one method.

    index: of the method, NaN where it could not be computed; yes_above, no_below: its published limits.
    note: why there is no index, or what else the method says.
    """

    name: str
    source: str
    index: float
    yes_above: float
    no_below: float
    note: str = ""

    @property
    def verdict(self) -> Verdict:
        """Above one limit yes, below the other no."""
        if math.isnan(self.index):
            return Verdict.UNDECIDED
        if self.index > self.yes_above:
            return Verdict.YES
        return Verdict.NO if self.index < self.no_below else Verdict.UNDECIDED
