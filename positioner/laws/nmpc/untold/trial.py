"""How well one candidate explains one course: the logarithm of the probability of its readings. Pure.

When the stem was freed is open: each step in which the force exceeded all before it is a possible onset, as is none at
all. For each of them a few Gauss-Newton steps fit the load to the readings, from what is known of it; the best one
counts, with Laplace's approximation for the load that nobody knows exactly.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.laws.nmpc.untold.linear import factor, inverse, log_determinant, solved
from positioner.laws.nmpc.untold.load import LEAST, MOST, LoadBelief, threshold
from positioner.laws.nmpc.untold.rollout import STATES, advanced, begun
from positioner.values import dataclass, replace

if TYPE_CHECKING:
    from positioner.laws.nmpc.untold.candidate import Pressures
    from positioner.laws.nmpc.untold.course import Course
    from positioner.laws.nmpc.untold.load import Nominal, Threshold
    from positioner.laws.nmpc.untold.rollout import Rollout

_MOST_ONSETS = 6
_MOST_STEPS = 5
_LONGEST = 0.25
"""The largest change of a multiple in one Gauss-Newton step."""
_CONVERGED = 0.5
"""A step that should lower the cost by less is the last one."""
_HOPELESS = 13.0
"""An onset whose fit is to stay so much less probable than the best one, of any candidate, is given up: a course does
not count for more."""
_LIKELY = 8.0
"""What a fit may explain better than the best one, at most."""
_MM2 = 1e6
_LEAST_VARIANCE = 1e-8
_EXCLUDED = 1e9


@dataclass(frozen=True, slots=True)
class Rises:
    """The steps of a course in which the force exceeds all before it, and the force, as a multiple of F_s."""

    step: list[int]
    force: list[float]

    def onset(self, first: int, last: int) -> Onset:
        """Return the onset in one of the rises from `first` to `last`."""
        least = self.force[first - 1] if first else -_EXCLUDED
        return Onset(first, last, self.step[(first + last) // 2], least, self.force[last])

    def none(self) -> Onset:
        """Return the onset that never comes."""
        return Onset(0, 0, -1, self.force[-1], _EXCLUDED)

    def split(self, first: int, last: int) -> tuple[Onset, ...]:
        """Return a few onsets that stand for those from `first` to `last`."""
        every = -(-(last - first + 1) // _MOST_ONSETS)
        return tuple([self.onset(each, min(each + every - 1, last)) for each in range(first, last + 1, every)])


@dataclass(frozen=True, slots=True)
class Onset:
    """A step in which the stem may have been freed, -1 for never: the force was between these multiples of F_s.

    first, last: it stands for the rises from one to the other.
    """

    first: int
    last: int
    step: int
    least: float
    most: float


@dataclass(frozen=True, slots=True)
class Fit:
    """The fit of one onset: what is known before it (mean, information), the point, and the run with it.

    log_prior: logarithm of the onset's probability and of the determinant of `information`, halved. count: steps made.
    evidence, best, matrix: of the best point so far.
    """

    mean: list[float]
    information: list[list[float]]
    log_prior: float
    point: list[float]
    rollout: Rollout
    count: int
    evidence: float
    best: list[float]
    matrix: list[list[float]]


@dataclass(frozen=True, slots=True)
class Trial:
    """A candidate's explanation of a course, as far as it is computed.

    given: its pressures. belief: the load before. to_beat: the evidence of the best candidate so far.
    onsets: those that are not computed yet; fit: the one at work. evidence, after, best: of the best onset so far; one
    that stands for several is split, until it is one. point: where its fit ended, the next one begins there.
    """

    course: Course
    given: Pressures
    belief: LoadBelief
    noise_m2: float
    to_beat: float
    freeing: Threshold
    rises: Rises
    onsets: tuple[Onset, ...]
    fit: Fit | None = None
    evidence: float = -_EXCLUDED
    after: LoadBelief | None = None
    best: Onset | None = None
    point: list[float] | None = None

    @property
    def is_over(self) -> bool:
        """Whether all is computed."""
        return self.fit is None and not self.onsets


def trial_of(
    nominal: Nominal, course: Course, given: Pressures, belief: LoadBelief, noise_m2: float, to_beat: float
) -> Trial:
    """Return the beginning of a trial."""
    belief = belief.wandered()
    freeing = threshold(nominal, belief, course)
    rises = _rises(nominal, course, given)
    onsets = (*rises.split(0, len(rises.step) - 1), rises.none())
    return Trial(course, given, belief, noise_m2, to_beat, freeing, rises, onsets)


def continued(nominal: Nominal, trial: Trial, budget: int) -> Trial:
    """Return the trial after as many steps as `budget` allows, within one run."""
    fit = trial.fit
    if fit is None:
        onset, rest = trial.onsets[0], trial.onsets[1:]
        inside = trial.freeing.between(trial.belief, onset.least, onset.most)
        if inside is None or inside[1] < max(trial.evidence, trial.to_beat) - _HOPELESS - _LIKELY:
            return _refined(replace(trial, onsets=rest))
        # the onset stays the first of the list until its fit is over
        return replace(trial, fit=_begun(trial.course, inside[0], inside[1], trial.point))
    onset = trial.onsets[0]
    rollout = advanced(
        nominal, trial.course, trial.given, fit.point[1:], onset.step, trial.noise_m2, fit.rollout, budget
    )
    if rollout.step < len(trial.given.piece):
        return replace(trial, fit=replace(fit, rollout=rollout))
    fit, is_last = _improved(trial.course, replace(fit, rollout=rollout), max(trial.evidence, trial.to_beat))
    if not is_last:
        return replace(trial, fit=fit)
    trial = replace(trial, onsets=trial.onsets[1:], fit=None)
    if fit.evidence > trial.evidence:
        covariance = inverse(fit.matrix)
        after = LoadBelief(fit.best[1:], [row[1:] for row in covariance[1:]])
        trial = replace(trial, evidence=fit.evidence, after=after, best=onset, point=fit.best)
    return _refined(trial)


def _refined(trial: Trial) -> Trial:
    """Return the trial; where only its best onset is left, which stands for several, those are tried next."""
    best = trial.best
    if trial.onsets or best is None or best.first == best.last or trial.evidence < trial.to_beat - _HOPELESS:
        return trial
    onsets = trial.rises.split(best.first, best.last)
    return replace(trial, onsets=onsets, evidence=-_EXCLUDED, best=None)


def _rises(nominal: Nominal, course: Course, given: Pressures) -> Rises:
    steps: list[int] = []
    forces: list[float] = []
    top = -_EXCLUDED
    for step in range(len(given.piece)):
        force = course.direction * nominal.model.push_n(given.mean_ma[step], 0.0, 0.0) / nominal.static_n
        if force > top:
            steps.append(step)
            forces.append(force)
            top = force
    return Rises(steps, forces)


def _begun(course: Course, belief: LoadBelief, log_probability: float, point: list[float] | None) -> Fit:
    """Return the fit of an onset before its first run, at the point where the best one has ended."""
    covariance = [[course.variance_m2 * _MM2 + _LEAST_VARIANCE, *([0.0] * STATES)]]
    covariance += [[0.0, *row] for row in belief.covariance]
    for i in range(1, STATES + 1):
        covariance[i][i] += _LEAST_VARIANCE
    mean = [0.0, *belief.values]
    information = inverse(covariance)
    log_prior = log_probability - 0.5 * log_determinant(factor(covariance))
    if point is None:
        point = mean
    return Fit(mean, information, log_prior, point, begun(course, point[0]), 0, -_EXCLUDED, point, information)


def _improved(course: Course, fit: Fit, to_beat: float) -> tuple[Fit, bool]:
    """Return the fit after a whole run, with the next point to run, and whether there is none."""
    size, rollout = STATES + 1, fit.rollout
    matrix = [row[:] for row in fit.information]
    pull = [0.0] * size
    cost = rollout.cost
    for i in range(size):
        if i < STATES:
            pull[i] = rollout.gradient[i]
            for j in range(STATES):
                matrix[i][j] += rollout.information[i][j]
        for j in range(size):
            by = fit.information[i][j] * (fit.point[j] - fit.mean[j])
            pull[i] -= by
            cost += by * (fit.point[i] - fit.mean[i])
    lower = factor(matrix)
    evidence = fit.log_prior - 0.5 * (cost + log_determinant(lower))
    if evidence > fit.evidence:
        fit = replace(fit, evidence=evidence, best=fit.point, matrix=matrix)
    change = solved(lower, pull)
    gain, longest = 0.0, 1.0
    for i in range(size):
        gain += change[i] * pull[i]
        if i:
            longest = max(longest, abs(change[i]) / _LONGEST)
    count = fit.count + 1
    if count == _MOST_STEPS or gain < _CONVERGED or evidence + 0.5 * gain < to_beat - _HOPELESS:
        return fit, True
    point = [fit.point[0] + change[0] / longest]
    point += [min(max(fit.point[i] + change[i] / longest, LEAST), MOST) for i in range(1, size)]
    return replace(fit, point=point, rollout=begun(course, point[0]), count=count), False
