"""Yamashita (2006): the share of the time in which OP moves while PV rests, without motions that do not fit. Pure.

Y. Yamashita, An automatic method for detection of valve stiction in process control loops, Control Engineering Practice
14 (2006) 503-510. Each signal goes up, rests or goes down, by the standard deviation of its differences.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from positioner.diagnostics.indirect.method import Answer

Array = NDArray[np.float64]

NAME, SOURCE = "YAM", "Yamashita 2006"
_LIMIT = 0.25


def symbols(op: Array, pv: Array) -> Answer:
    """Return ρ_3: the share of "OP moves, PV rests", less the runs of it that end with a motion that does not fit."""
    moves, follows = _symbols(op), _symbols(pv)
    total = int(np.sum((moves != 0) | (follows != 0)))
    if total == 0:
        return Answer(NAME, SOURCE, math.nan, _LIMIT, _LIMIT, "nothing moves")
    sticks = (moves != 0) & (follows == 0)
    fits = 0
    at = 0
    while at < moves.size:
        if not sticks[at]:
            at += 1
            continue
        end, way = at, int(moves[at])
        while end < moves.size and sticks[end] and moves[end] == way:
            end += 1
        turns = end < moves.size and (moves[end] == -way or follows[end] == -way)
        fits += 0 if turns else end - at
        at = end
    share = float(np.sum(sticks)) / total
    return Answer(NAME, SOURCE, fits / total, _LIMIT, _LIMIT, f"OP moves and PV rests in {share:.0%}")


def _symbols(signal: Array) -> NDArray[np.int64]:
    """Return +1, 0 or -1 for each difference."""
    change = np.diff(signal)
    size = float(np.std(change))
    return np.asarray(np.where(np.abs(change) > size, np.sign(change), 0.0), dtype=np.int64)
