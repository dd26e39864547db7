"""What is printed of many durations."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence


@dataclass(frozen=True, slots=True)
class Distribution:
    """Quantiles of durations in µs, and how many there were."""

    count: int
    median: float
    p99: float
    p999: float
    largest: float

    @classmethod
    def of(cls, durations_ns: Sequence[int]) -> Distribution:
        """Return the distribution; a quantile is the smallest duration that so many do not exceed."""
        ordered = sorted(durations_ns)

        def quantile(part: float) -> float:
            return ordered[max(math.ceil(part * len(ordered)), 1) - 1] / 1e3

        return cls(len(ordered), quantile(0.5), quantile(0.99), quantile(0.999), ordered[-1] / 1e3)


def smallest(rounds: Sequence[Sequence[int]]) -> list[int]:
    """Return the smallest of every column: rounds (R, n) -> (n,)."""
    return [min(column) for column in zip(*rounds, strict=True)]
