"""The explanation of a course by every candidate, a little in each cycle, and the evidence for them. Pure.

Evidence is the logarithm of a probability. No single course counts for too much, and one that no candidate explains
counts for nothing: something else has happened in it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.laws.nmpc.untold.candidate import pressures
from positioner.laws.nmpc.untold.trial import continued, trial_of
from positioner.values import dataclass, replace

if TYPE_CHECKING:
    from positioner.laws.nmpc.untold.candidate import Candidate
    from positioner.laws.nmpc.untold.course import Finished
    from positioner.laws.nmpc.untold.load import LoadBelief, Nominal
    from positioner.laws.nmpc.untold.trial import Trial

_MOST_OF_ONE = 12.0
"""No single course counts for more."""
_HOPELESS = 20.0
"""A candidate that is so far behind is dropped."""
_UNEXPLAINED, _UNEXPLAINED_PER_PIECE = 12.0, 1.0
"""A course is explained where minus the evidence of the best candidate is below this."""


@dataclass(frozen=True, slots=True)
class Mind:
    """A candidate, the load as it sees it, the pressure after the last course (None: not known), and its evidence."""

    candidate: Candidate
    belief: LoadBelief
    pressure_ma: float | None = None
    evidence: float = 0.0


@dataclass(frozen=True, slots=True)
class Work:
    """A course that is being explained, by one mind after another in this `order`.

    done: the minds so far, with the evidence of this course alone, and where there is an explanation the belief after.
    """

    finished: Finished
    order: tuple[int, ...]
    trial: Trial | None = None
    done: tuple[Mind, ...] = ()


def begun_work(minds: tuple[Mind, ...], finished: Finished) -> Work:
    """Return the work on a course before its first cycle: the mind with the most evidence comes first."""
    ranked = [(-minds[i].evidence, i) for i in range(len(minds))]
    ranked.sort()
    return Work(finished, tuple([i for _, i in ranked]))


def continued_work(
    nominal: Nominal, minds: tuple[Mind, ...], work: Work, period_s: float, budget: int
) -> tuple[tuple[Mind, ...], Work | None]:
    """Return the minds and the work after one more cycle of it, None where it is over."""
    finished, trial, mind = work.finished, work.trial, minds[work.order[len(work.done)]]
    if trial is None:
        to_beat = -math.inf
        for each in work.done:
            to_beat = max(to_beat, each.evidence)
        trial = _trial(nominal, mind, finished, period_s, to_beat)
    else:
        trial = continued(nominal, trial, budget)
    if not trial.is_over:
        return minds, replace(work, trial=trial)
    belief = mind.belief if trial.after is None else trial.after
    done = (*work.done, Mind(mind.candidate, belief, trial.given.end_ma, trial.evidence))
    if len(done) < len(minds):
        return minds, replace(work, trial=None, done=done)
    return _judged(minds, work.order, done, len(finished.course.pieces)), None


def _trial(nominal: Nominal, mind: Mind, finished: Finished, period_s: float, to_beat: float) -> Trial:
    """Return the beginning of the explanation of a course by one candidate."""
    course, pressure_ma = finished.course, mind.pressure_ma
    for piece in finished.between:
        if pressure_ma is None:
            pressure_ma = piece.current_ma
        pressure_ma = mind.candidate.after(pressure_ma, piece.current_ma, piece.samples * period_s)
    if pressure_ma is None:
        pressure_ma = course.pieces[0].current_ma
    given = pressures(mind.candidate, course.pieces, pressure_ma, period_s)
    return trial_of(nominal, course, given, mind.belief, finished.noise_m2, to_beat)


def _judged(before: tuple[Mind, ...], order: tuple[int, ...], done: tuple[Mind, ...], pieces: int) -> tuple[Mind, ...]:
    """Return the minds after a course, without those that are far behind; `done` stands in this order."""
    best = -math.inf
    for mind in done:
        best = max(best, mind.evidence)
    is_explained = -best <= _UNEXPLAINED + _UNEXPLAINED_PER_PIECE * pieces
    after, leading = list(before), -math.inf
    for i in range(len(done)):
        old, new = before[order[i]], done[i]
        if is_explained:
            evidence = old.evidence + max(new.evidence - best, -_MOST_OF_ONE)
            after[order[i]] = replace(new, evidence=evidence)
            leading = max(leading, evidence)
        else:
            after[order[i]] = replace(old, pressure_ma=new.pressure_ma)
    return tuple([after[i] for i in range(len(after)) if i == 0 or after[i].evidence > leading - _HOPELESS])
