"""All methods on one loop, and what they say together. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from positioner.diagnostics.indirect import shapes
from positioner.diagnostics.indirect.bicoherence import bicoherence, ellipse_width
from positioner.diagnostics.indirect.correlation import correlation
from positioner.diagnostics.indirect.hammerstein import models
from positioner.diagnostics.indirect.loop import SAMPLES_PER_PERIOD, Loop, block_means, steady
from positioner.diagnostics.indirect.oscillation import Oscillation, half_cycles, oscillation_of
from positioner.diagnostics.indirect.pitfalls import Pitfalls, pitfalls_of
from positioner.diagnostics.indirect.symbols import symbols
from positioner.diagnostics.verdict import Estimate, Verdict

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from positioner.diagnostics.indirect.method import Answer

_MODELS, _DECIDING = ("HAMM", "ADD"), ("HAMM", "ADD", "YAM", "CORR")
_SHAPES = ("CURVE", "RELAY")
_FEWEST = 400
"""Samples that downsampling leaves, at least, where there are as many."""
_MOST = 8000
"""Samples, after downsampling, in which the methods look."""
_MOST_FOR_PERIOD = 50_000
LEAST_SAMPLES = 200
_ANSWERS = 16.81
"""The 99 % quantile of chi-square with as many degrees of freedom as OP has lags, six."""


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """What OP and PV say about the valve.

    answers: of the methods; reason: of the verdict; stick: S in the unit of OP with its interval, None where no model
    found a valve that sticks; ellipse: the apparent S of PV over OP; factor: samples that one of the methods is the
    mean of; oscillation: in samples of the record; notes: what a reader must know besides.
    """

    verdict: Verdict
    reason: str
    answers: tuple[Answer, ...]
    stick: Estimate | None
    ellipse: float
    oscillation: Oscillation
    factor: int
    notes: tuple[str, ...]


def diagnose_loop(loop: Loop) -> Diagnosis:
    """Return the diagnosis of a loop of at least `LEAST_SAMPLES` samples."""
    keep = steady(loop)
    begin, end = _longest(keep)
    end = min(end, begin + _MOST_FOR_PERIOD)
    oscillation = oscillation_of(loop.op[begin:end])
    factor = max(min(int(oscillation.period / SAMPLES_PER_PERIOD), loop.op.size // _FEWEST), 1)
    coarse = loop.coarser(factor)
    kept = block_means(keep.astype(np.float64), factor) > 0.999  # noqa: PLR2004 - all of them
    part = coarse.part(begin // factor, min(end // factor, begin // factor + _MOST))
    period, error = oscillation.period / factor, part.error
    of_pv, of_op = half_cycles(error, period), half_cycles(part.op, period)
    first = max((coarse.op.size - _MOST) // 2, 0)
    middle = coarse.part(first, first + _MOST)
    found = models(middle.op, middle.pv - float(np.mean(middle.pv)), kept[first : first + _MOST])
    answers = (
        found.hammerstein,
        found.ratio,
        symbols(part.op, error),
        correlation(part.op, error, period),
        shapes.curve(of_op, "OP"),
        shapes.relay(of_pv),
        shapes.area(of_pv),
        bicoherence(error),
    )
    pitfalls = pitfalls_of(loop, keep)
    if found.is_smallest and not pitfalls.doubt:
        pitfalls = replace(pitfalls, doubt="the S that fits best is the smallest that was tried")
    if found.response < _ANSWERS and not pitfalls.quiet:
        text = "PV does not show that it answers OP, and behind a stem that rests it would be the same"
        pitfalls = replace(pitfalls, quiet=f"{text}: a record with setpoint steps is needed")
    verdict, reason = combined(answers, pitfalls)
    stick = found.stick if verdict is Verdict.YES and not math.isnan(found.stick.value) else None
    ellipse = ellipse_width(part.op, error)
    return Diagnosis(verdict, reason, answers, stick, ellipse, oscillation, factor, pitfalls.notes)


def combined(answers: tuple[Answer, ...], pitfalls: Pitfalls) -> tuple[Verdict, str]:
    """Return the verdict of all, and its reason.

    Yes where PV stands still while OP moves, or where two of HAMM, ADD, YAM and CORR say yes, one of them with a model
    of the valve: an external sinusoid fools the other two together, and now and then all four, so where the half cycles
    of OP and of PV are both sines the answer is undecided. No where none of the four says yes, and OP moved so far
    that a valve that sticks would have shown it.
    """
    if pitfalls.is_stuck:
        return Verdict.YES, "OP moves for a persistent error, and PV does not answer: the valve is stuck, or cut off"
    if pitfalls.unexcited:
        return Verdict.UNDECIDED, pitfalls.unexcited
    deciding = [each for each in answers if each.name in _DECIDING]
    said = [each.name for each in deciding if each.verdict is Verdict.YES]
    if said:
        return _with(said, pitfalls.doubt or _sinusoidal(answers))
    if all(math.isnan(each.index) for each in deciding if each.name in _MODELS):
        return Verdict.UNDECIDED, next(each.note for each in deciding if each.name in _MODELS)
    if pitfalls.quiet:
        return Verdict.UNDECIDED, pitfalls.quiet
    return Verdict.NO, f"none of {_and(list(_DECIDING))} says yes"


def _with(said: list[str], doubt: str) -> tuple[Verdict, str]:
    """Return what follows from the methods that say yes."""
    if len(said) == 1:
        return Verdict.UNDECIDED, f"only {said[0]} says yes"
    if not any(name in _MODELS for name in said):
        return Verdict.UNDECIDED, f"{_and(said)} say yes, and no model of the valve does"
    if doubt:
        return Verdict.UNDECIDED, f"{_and(said)} say yes, but {doubt}"
    return Verdict.YES, f"{_and(said)} say yes"


def _sinusoidal(answers: tuple[Answer, ...]) -> str:
    """Return a doubt where the half cycles of OP (CURVE) and of PV (RELAY) are both sines."""
    sines = {each.name for each in answers if each.name in _SHAPES and each.verdict is Verdict.NO}
    return "OP and PV are both sinusoids, as under an external oscillation" if sines == set(_SHAPES) else ""


def _and(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _longest(keep: NDArray[np.bool_]) -> tuple[int, int]:
    """Return where the longest stretch without a gap begins and ends."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], keep.astype(np.int64), [0]])))
    begins, ends = edges[::2], edges[1::2]
    longest = int(np.argmax(ends - begins))
    return int(begins[longest]), int(ends[longest])
