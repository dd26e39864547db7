"""The dynamic stress factor: how much of its life the packing has spent, by the spans of the cycles. Pure.

It is the sum over the classes of spans of count/allowed, as for the fatigue of a material (Palmgren, Miner). Between
two points that the user gives, the allowed cycles follow a power of the span; beyond them the nearest one counts.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING

from positioner.health.classes import SPAN_EDGES_PERCENT

if TYPE_CHECKING:
    from collections.abc import Sequence


def wear_of(allowed: Sequence[tuple[float, float]]) -> tuple[float, ...]:
    """Return the part of the packing's life that a cycle of each class of spans takes; empty without `allowed`.

    A class counts with its largest span, the open one with 100 %.
    """
    if not allowed:
        return ()
    spans = [edge / 100.0 for edge in SPAN_EDGES_PERCENT]
    return tuple([1.0 / _allowed(allowed, span) for span in (*spans, 1.0)])


def _allowed(allowed: Sequence[tuple[float, float]], span: float) -> float:
    if span <= allowed[0][0]:
        return allowed[0][1]
    for (low, most), (high, least) in pairwise(allowed):
        if span <= high:
            power = math.log(least / most) / math.log(high / low)
            return most * math.exp(power * math.log(span / low))
    return allowed[-1][1]


def stress(wear: Sequence[float], spans: Sequence[int]) -> float:
    """Return the part of the packing's life that these cycles have taken, by their classes."""
    total = 0.0
    for part, count in zip(wear, spans, strict=True):
        total += part * count
    return total
