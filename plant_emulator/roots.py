"""The instants of events: first zeros that cannot be missed, and zeros in a known interval. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

TIME_TOLERANCE_S = 1e-13
"""An instant this near to an event counts as the event: at 1 m/s, a thousandth of an atom."""

_BISECTIONS = 200
_MARCHES = 500
_WIDER, _LONGER = 10.0, 1.5
"""Of a stride: the window in which a longer one is looked for, and the gain that is worth the search."""


def clear_time(gap: float, slope: float, bend: float) -> float:
    """Return the time in s for which a quantity is sure to stay above zero: it is `gap` now, and changes at `slope`.

    `bend` bounds the size of its second derivative. The time is the positive zero of gap + slope·t - bend·t²/2.
    """
    if gap == math.inf:
        return math.inf
    if bend <= 0.0:
        return math.inf if slope >= 0.0 else max(gap, 0.0) / -slope
    spread = math.sqrt(slope * slope + 2.0 * bend * max(gap, 0.0))
    # the two forms are equal; each avoids a loss of digits in the other
    return (slope + spread) / bend if slope >= 0.0 else 2.0 * max(gap, 0.0) / (spread - slope)


def clear_within(gap: float, slope: float, stride_s: float, left_s: float, bend: Callable[[float], float]) -> float:
    """Return a longer clear time than `stride_s`, that of the bound for all of `left_s`, where there is one.

    `bend(window_s)` bounds the second derivative for that long only. So a quantity that will change quickly later does
    not shorten the strides of now.
    """
    while stride_s < left_s:
        window_s = min(_WIDER * stride_s, left_s)
        longer_s = min(clear_time(gap, slope, bend(window_s)), window_s)
        if longer_s <= _LONGER * stride_s:
            break
        stride_s = longer_s
    return stride_s


def first_event(clear: Callable[[float], float], horizon_s: float) -> tuple[float, bool]:
    """Return the time of the first event before `horizon_s` and True, or the time that was reached and False.

    `clear(t)` returns the time in s after t in which there is no event for sure. No event is missed, however brief.
    Near an event the search converges as fast as Newton's method. Where two events nearly touch it may stop before
    both.
    """
    time = 0.0
    for _ in range(_MARCHES):
        stride = clear(time)
        if time + stride >= horizon_s:
            return horizon_s, False
        if stride < TIME_TOLERANCE_S:
            return time, True
        time += stride
    return time, False


def crossing(gap: Callable[[float], float], low_s: float, high_s: float) -> float:
    """Return where `gap` changes sign between `low_s` and `high_s`, by the Illinois method.

    Where rounding leaves no change of sign, the zero is at `low_s`.
    """
    low, high = gap(low_s), gap(high_s)
    if low == 0.0 or (high != 0.0 and (low > 0.0) == (high > 0.0)):
        return low_s
    for _ in range(_BISECTIONS):
        if high == 0.0 or abs(high_s - low_s) < TIME_TOLERANCE_S:
            break
        middle_s = high_s - high * (high_s - low_s) / (high - low)
        middle = gap(middle_s)
        if (middle > 0.0) == (high > 0.0):
            low *= 0.5
        else:
            low_s, low = high_s, high
        high_s, high = middle_s, middle
    return high_s
