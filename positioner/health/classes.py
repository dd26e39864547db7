"""The classes of the histograms, and the class of a value. Pure."""

from __future__ import annotations

from bisect import bisect_right

TRAVEL_EDGES_PERCENT = tuple(float(edge) for edge in range(0, 101, 5))
"""Of the span: below 0, twenty classes of 5 %, 100 and above."""
DEVIATION_EDGES_PERCENT = (-10.0, -5.0, -2.0, -1.0, -0.5, -0.2, -0.1, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
"""Of the span: the setpoint minus the position."""
SPAN_EDGES_PERCENT = tuple(float(edge) for edge in range(5, 101, 5))
"""Of the span: the spans between two reversals."""


RECENT = 100
"""So many samples are in a short histogram."""


def empty(edges: tuple[float, ...]) -> tuple[int, ...]:
    """Return a histogram with no sample: one class more than there are edges."""
    return (0,) * (len(edges) + 1)


def class_of(edges: tuple[float, ...], value: float) -> int:
    """Return the number of the class of a value; a class holds its lower edge, and not its upper one."""
    return bisect_right(edges, value)


def counted(histogram: tuple[int, ...], edges: tuple[float, ...], value: float) -> tuple[int, ...]:
    """Return the histogram with `value` in it."""
    at = class_of(edges, value)
    return (*histogram[:at], histogram[at] + 1, *histogram[at + 1 :])


def with_newest(recent: tuple[int, ...], newest: int) -> tuple[int, ...]:
    """Return the classes of the last 100 samples, the newest last."""
    return (*recent[-(RECENT - 1) :], newest)


def short(recent: tuple[int, ...], edges: tuple[float, ...]) -> tuple[int, ...]:
    """Return the histogram of the last samples, by their classes."""
    return tuple([recent.count(at) for at in range(len(edges) + 1)])
