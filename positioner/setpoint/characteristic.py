"""The characteristic of a setpoint: travel h over signal w, both from 0 to 1, and its inverse. Pure.

    linear                      h = w
    equal percentage            h = (R^w - 1)/(R - 1), anchored at 0: the same change of w multiplies h + 1/(R - 1)
    inverse equal percentage    h = 1 - f(1 - w), of the equal percentage f
    quick opening               h = √w
    points                      straight lines between the points

Each is strictly rising, and exact at both ends.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.setpoint.settings import Action, Characteristic

if TYPE_CHECKING:
    from positioner.setpoint.settings import SetpointSettings


def travel_of(settings: SetpointSettings, signal: float) -> float:
    """Return the travel that belongs to a signal: split range, direction of action, characteristic."""
    w = _within(_share(signal, settings.signal_low, settings.signal_high))
    return shaped(settings, 1.0 - w if settings.action is Action.REVERSE else w)


def signal_of(settings: SetpointSettings, travel: float) -> float:
    """Return the signal that asks for a travel: the inverse of `travel_of`."""
    w = unshaped(settings, _within(travel))
    w = 1.0 - w if settings.action is Action.REVERSE else w
    return settings.signal_low + w * (settings.signal_high - settings.signal_low)


def shaped(settings: SetpointSettings, w: float) -> float:
    """Return h of w, both from 0 to 1."""
    kind, r = settings.characteristic, settings.rangeability
    if w <= 0.0 or w >= 1.0 or kind is Characteristic.LINEAR:
        return w
    if kind is Characteristic.EQUAL_PERCENTAGE:
        return math.expm1(w * math.log(r)) / (r - 1.0)
    if kind is Characteristic.INVERSE_EQUAL_PERCENTAGE:
        return 1.0 - math.expm1((1.0 - w) * math.log(r)) / (r - 1.0)
    if kind is Characteristic.QUICK_OPENING:
        return math.sqrt(w)
    return _between(settings.points, w, 0)


def unshaped(settings: SetpointSettings, h: float) -> float:
    """Return w of h, both from 0 to 1."""
    kind, r = settings.characteristic, settings.rangeability
    if h <= 0.0 or h >= 1.0 or kind is Characteristic.LINEAR:
        return h
    if kind is Characteristic.EQUAL_PERCENTAGE:
        return math.log1p(h * (r - 1.0)) / math.log(r)
    if kind is Characteristic.INVERSE_EQUAL_PERCENTAGE:
        return 1.0 - math.log1p((1.0 - h) * (r - 1.0)) / math.log(r)
    if kind is Characteristic.QUICK_OPENING:
        return h * h
    return _between(settings.points, h, 1)


def _between(points: tuple[tuple[float, float], ...], value: float, known: int) -> float:
    """Return the other coordinate on the lines through the points, where coordinate `known` (0 or 1) is `value`."""
    before = points[0]
    for after in points:
        if value <= after[known]:
            break
        before = after
    if value <= before[known]:
        return before[1 - known]
    share = _share(value, before[known], after[known])
    return before[1 - known] + share * (after[1 - known] - before[1 - known])


def _share(value: float, low: float, high: float) -> float:
    return (value - low) / (high - low)


def _within(value: float) -> float:
    return min(max(value, 0.0), 1.0)
