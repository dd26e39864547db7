"""The classes of the histograms, and the class of a value. Pure."""

from __future__ import annotations

from bisect import bisect_right

TRAVEL_EDGES_PERCENT = tuple(float(edge) for edge in range(0, 101, 5))
"""Of the span: below 0, twenty classes of 5 %, 100 and above."""
DEVIATION_EDGES_PERCENT = (-10.0, -5.0, -2.0, -1.0, -0.5, -0.2, -0.1, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
"""Of the span: the setpoint minus the position."""
SPAN_EDGES_PERCENT = tuple(float(edge) for edge in range(5, 101, 5))
"""Of the span: the spans between two reversals."""


def empty(edges: tuple[float, ...]) -> tuple[int, ...]:
    """Return a histogram with no sample: one class more than there are edges."""
    return (0,) * (len(edges) + 1)


def counted(histogram: tuple[int, ...], edges: tuple[float, ...], value: float) -> tuple[int, ...]:
    """Return the histogram with `value` in it; a class holds its lower edge, and not its upper one."""
    at = bisect_right(edges, value)
    return (*histogram[:at], histogram[at] + 1, *histogram[at + 1 :])
