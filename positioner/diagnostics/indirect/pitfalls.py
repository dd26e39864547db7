"""What makes a loop look as if its valve stuck, or hides that it does. Pure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from positioner.diagnostics import verdict
from positioner.diagnostics.indirect.loop import Loop, range_of, robust_sigma

Array = NDArray[np.float64]

_COARSE = 0.5
"""Of the standard deviation of PV: a larger step of its values hides its shape."""
_INTERPOLATED = 0.5
"""Of the samples: as many that lie on a straight line with their neighbours come from a compressed history."""
_SATURATED = 0.05
"""Of the samples, at either limit."""
_BLOCKS = 20
_STUCK_MOVES = 5.0
"""Percent of OP that it moves at least while PV does nothing."""


@dataclass(frozen=True, slots=True)
class Pitfalls:
    """What stands out in a record.

    is_stuck: PV does nothing while OP moves for an error that stays; doubt: why a yes would be worth little;
    unexcited: why the record says nothing; quiet: why a no would be worth nothing; notes: what the reader must know.
    """

    is_stuck: bool
    doubt: str
    unexcited: str
    notes: tuple[str, ...]
    quiet: str = ""


def pitfalls_of(loop: Loop, keep: NDArray[np.bool_]) -> Pitfalls:
    """Return what stands out in the record."""
    notes = []
    left_out = 1.0 - float(np.mean(keep))
    if left_out > 0.0:
        notes.append(f"setpoint steps: {left_out:.0%} of the record, the transients after them, is left out")
    step = _quantum(loop.pv)
    doubt = ""
    if step > _COARSE * float(np.std(loop.pv)):
        doubt = f"PV has steps of {step:.3g}, too coarse to see a shape"
    straight = 0.0 if step > 0.0 else _straight(loop.pv)
    if straight > _INTERPOLATED:
        doubt = f"{straight:.0%} of PV lies on straight lines: a compressed history, not readings"
    if _saturates(loop.op):
        doubt = "OP swings between two limits, which makes a cycle of its own"
    unexcited = ""
    if float(np.ptp(loop.op)) <= 0.0:
        unexcited = "OP stands still: nothing shows what the valve does"
    elif float(np.ptp(loop.pv)) <= 0.0:
        unexcited = "OP moves, and PV stands still: the valve is stuck, or PV is not measured"
    moved = range_of(loop.op)
    quiet = verdict.unexcited(moved) if moved <= verdict.LEAST_RANGE_PERCENT else ""
    return Pitfalls(_is_stuck(loop), doubt, unexcited, tuple(notes), quiet)


def _saturates(op: Array) -> bool:
    """Return whether OP stays at its lowest and at its highest value for a good part of the time."""
    return (
        all(float(np.mean(op == limit)) > _SATURATED for limit in (np.min(op), np.max(op))) and float(np.ptp(op)) > 0.0
    )


def _quantum(values: Array) -> float:
    """Return the step of quantised values, 0 where no step repeats."""
    levels = np.unique(values)
    if levels.size < 2 or levels.size > 0.2 * values.size:  # noqa: PLR2004
        return 0.0
    return float(np.median(np.diff(levels)))


def _straight(values: Array) -> float:
    """Return the share of samples that move, and lie on the line through their neighbours."""
    first = np.diff(values)
    second = np.abs(np.diff(first))
    size = 1e-6 * max(float(np.max(np.abs(values))), 1e-12)
    moving = np.abs(first[1:]) > size
    return float(np.mean(second[moving] <= size)) if np.any(moving) else 0.0


def _is_stuck(loop: Loop) -> bool:
    """Return whether OP goes far in one direction for an error that keeps its sign, and PV stays within its noise."""
    if not loop.sp.size or loop.op.size < 4 * _BLOCKS:
        return False
    error = loop.pv - loop.sp
    parts = np.array_split(np.arange(loop.op.size), _BLOCKS)
    levels = np.array([float(np.mean(loop.pv[each])) for each in parts])
    noise = float(np.median([robust_sigma(loop.pv[each]) for each in parts]))
    length = loop.op.size // _BLOCKS
    rests = float(np.ptp(levels)) <= max(4.0 * noise / np.sqrt(length) * 2.0, 1e-9)
    stays = abs(float(np.mean(error))) > 3.0 * max(noise, 1e-12)
    return bool(rests and stays and float(np.ptp(loop.op)) >= _STUCK_MOVES)
