"""The slips in a record of command and stem position: where the stem rested, left, and came to rest again. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LEAST_REST = 3
"""Samples of the shortest rest."""
_CREEPS = 4.0
_STANDS_OUT = 4.0
"""Standard deviations of the noise by which a reading leaves a rest; the next reading confirms it by three."""
_CONFIRMS = 3.0
_LATE = 0.75


@dataclass(frozen=True, slots=True)
class Rest:
    """Samples `begin` to before `end` in which the stem did not move, and the mean of their readings."""

    begin: int
    end: int
    place: float


@dataclass(frozen=True, slots=True)
class Slip:
    """One motion between two rests.

    direction: ±1; before, after: the two rests; command_at_slip: the middle between the farthest command that did not
    move the stem and the first one that did; half_step: half of their distance; command_at_stop: the farthest command
    of the end of the motion, and stop_step half of its change there.
    """

    direction: float
    before: Rest
    after: Rest
    command_at_slip: float
    half_step: float
    command_at_stop: float
    stop_step: float = 0.0


def noise_of(position: Array) -> float:
    """Return the standard deviation of the noise of a reading: that of second differences where the stem rests.

    The median of 16 samples each, and of these the lower quartile: a record may move most of the time.
    """
    second = np.abs(position[2:] - 2.0 * position[1:-1] + position[:-2])
    whole = second[: second.size // 16 * 16].reshape(-1, 16)
    middle = np.median(whole if whole.size else second.reshape(1, -1), axis=1)
    return float(np.quantile(middle, 0.25)) / (0.6745 * math.sqrt(6.0)) * 1.08


def rests_in(position: Array, noise: float, least: int = LEAST_REST) -> list[Rest]:
    """Return the rests in order.

    A rest begins with `least` readings that agree, and ends before two readings that lie off its mean to the same side.
    Of many readings those count as no rest through which the stem creeps.
    """
    readings, count = position.tolist(), position.size
    agree = (_STANDS_OUT + math.log(least / LEAST_REST)) * noise
    found, start = [], 0
    while start + least <= count:
        first = readings[start : start + least]
        if max(first) - min(first) > agree:
            start += 1
            continue
        total, at = math.fsum(first), start + least
        while at < count:
            number = at - start
            off = readings[at] - total / number
            wide = math.sqrt(1.0 + 1.0 / number) * noise
            if abs(off) > _STANDS_OUT * wide:
                following = readings[at + 1] - total / number if at + 1 < count else 0.0
                if math.copysign(1.0, off) * following > _CONFIRMS * wide:
                    break
            total += readings[at] if abs(off) <= _STANDS_OUT * wide else total / number
            at += 1
        if least == LEAST_REST or not _creeps(position[start:at], noise):
            found.append(Rest(start, at, total / (at - start)))
        start = at
    return found


def _creeps(readings: Array, noise: float) -> bool:
    """Return whether a straight line through the readings rises by more than its noise allows."""
    time = np.linspace(-1.0, 1.0, readings.size)
    square = float(time @ time)
    return abs(float(time @ readings)) > _CREEPS * noise * math.sqrt(square)


def slips_in(command: Array, position: Array, noise: float, factor: int = 1, least: int = LEAST_REST) -> list[Slip]:
    """Return the slips from rest to rest.

    Each reading is the mean of `factor` samples; `command` has all of them, and acted on the stem before the reading.
    """
    found = []
    for rest, following in pairwise(rests_in(position, noise, least)):
        way = following.place - rest.place
        count = 1.0 / (rest.end - rest.begin) + 1.0 / (following.end - following.begin)
        if abs(way) < _STANDS_OUT * noise * math.sqrt(count):
            continue
        side = math.copysign(1.0, way)
        leaves, stops = rest.end * factor, following.begin * factor
        moved = side * float(np.max(side * command[leaves : leaves + factor]))
        held = side * min(float(np.max(side * command[rest.begin * factor : leaves])), side * moved)
        # a controller that sees the motion takes the command back at once: the last quarter of it counts
        late = command[min(leaves + math.ceil(_LATE * (stops - leaves)), stops) : stops + 1]
        farthest = side * float(np.max(side * late))
        middle, half = 0.5 * (held + moved), 0.5 * abs(moved - held)
        found.append(Slip(side, rest, following, middle, half, farthest, 0.5 * float(np.ptp(late))))
    return found
