"""Watches the moves of a law for an actuator that is not the one it believes in. Pure.

A course begins with a push from a rest, and ends with the next one or after a long rest. In the cycles at rest each
course is explained by each candidate, a little in each cycle (`work`), and the evidence adds up. A candidate that is
far behind is dropped; where only the believed one is left, the watch is over.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.laws.nmpc.filter import believed_m
from positioner.laws.nmpc.untold.candidate import candidates
from positioner.laws.nmpc.untold.course import MOST_PIECES, Course, Finished, joined
from positioner.laws.nmpc.untold.load import prior
from positioner.laws.nmpc.untold.work import Mind, begun_work, continued_work
from positioner.values import dataclass, replace

if TYPE_CHECKING:
    from positioner.laws.nmpc.untold.course import Piece
    from positioner.laws.nmpc.untold.load import Nominal
    from positioner.laws.nmpc.untold.work import Work

_QUIET = 3
"""Readings at rest after which a push begins a course."""
_LONGEST_REST = 64
"""Readings at rest after which a course is over."""
_RECENT = 16
_UNSTEADY = 4.5
"""Standard deviations between recent readings and all of a rest: then it is none."""
_CERTAIN, _CERTAIN_OF_SHORT, _CERTAIN_OF_DEAD_TIME = 8.0, 16.0, 40.0
"""A short lag or a sample of dead time does little harm, and differs little from none."""
_KEPT, _NEAR = 6.0, 0.7
"""The lead of a lag that is kept from before; and how far from it, in logarithms, a candidate may be."""
_MOST_WAITING = 6
_MOST_UNMOVED = 2
_UNLIKELY, _LEAST_S = 1.0, 0.7e-3
"""A lag that is so far behind, or so short, is not worth an experiment."""
_ENOUGH, _MOST = 10, 40
"""After so many courses the watch ends where no lag is likely, and at last in any case."""
_BEHIND, _AHEAD = 5.0, 3.0
"""A lag is not likely that is so far behind, and a short one or a dead time that is no farther ahead."""
_BUDGET = 60
"""Of a cycle, in steps of a resting stem."""


@dataclass(frozen=True, slots=True)
class Quiet:
    """A stem at rest: the mean of so many readings, and of the recent ones."""

    readings: int = 0
    mean_m: float = 0.0
    recent_m: float = 0.0

    def followed_by(self, measured_m: float, noise_m2: float) -> Quiet:
        """Return the rest after a reading; a stem that creeps begins anew."""
        count = self.readings + 1
        if count == 1:
            return Quiet(1, measured_m, measured_m)
        if count > _QUIET:
            measured_m = believed_m(self.recent_m, 0.0, measured_m, noise_m2)
        off_m = self.recent_m - self.mean_m
        if count > _QUIET + 2:
            doubt_m2 = noise_m2 * (1.0 / (2.0 * _RECENT - 1.0) + 1.0 / self.readings)
            if off_m * off_m > _UNSTEADY * _UNSTEADY * doubt_m2:
                return Quiet(1, measured_m, measured_m)
        mean_m = self.mean_m + (measured_m - self.mean_m) / count
        return Quiet(count, mean_m, self.recent_m + (measured_m - self.recent_m) / min(_RECENT, count))


@dataclass(frozen=True, slots=True)
class Watch:
    """What the watch carries.

    minds: the candidates that are left, the believed one first. quiet: the present rest. course: the present move.
    rest: readings at rest in it. between, same: the time since the last course. work: the course that is explained now.
    waiting: courses that are to be explained, the oldest first. unmoved: those in a row whose push freed no stem.
    explained: how many courses there were an explanation of.
    """

    minds: tuple[Mind, ...]
    quiet: Quiet
    course: Course | None = None
    rest: int = 0
    between: tuple[Piece, ...] = ()
    same: int = 0
    work: Work | None = None
    waiting: tuple[Finished, ...] = ()
    unmoved: int = 0
    explained: int = 0

    @property
    def is_over(self) -> bool:
        """Whether only the believed actuator is left."""
        return len(self.minds) == 1

    @property
    def wants_probe(self) -> bool:
        """Whether so many pushes have failed in a row that an experiment is worth its time: a lag may be the reason."""
        if self.unmoved <= _MOST_UNMOVED:
            return False
        for mind in self.minds:
            if mind.candidate.lag_s > _LEAST_S and mind.evidence > self.minds[0].evidence - _UNLIKELY:
                return True
        return False

    @property
    def is_at_work(self) -> bool:
        """Whether a course is not explained yet."""
        return not self.is_over and (self.course is not None or self.work is not None or bool(self.waiting))

    @property
    def leader(self) -> Mind | None:
        """The mind that is certainly right where the believed one is wrong, else None."""
        best = self.minds[0]
        for mind in self.minds:
            if mind.evidence > best.evidence:
                best = mind
        enough = _CERTAIN if best.candidate.lag_s > _LEAST_S else _CERTAIN_OF_SHORT
        if best.candidate.late:
            enough = _CERTAIN_OF_DEAD_TIME
        return best if best.evidence - self.minds[0].evidence > enough else None


def begun(period_s: float) -> Watch:
    """Return the watch before the first move."""
    return Watch(tuple([Mind(each, prior()) for each in candidates(period_s)]), Quiet())


def with_kept(watch: Watch, lag_s: float) -> Watch:
    """Return the watch before the first move of a valve that had this lag before: the nearest candidate leads."""
    best, nearest = -1, _NEAR
    for index in range(len(watch.minds)):
        other_s = watch.minds[index].candidate.lag_s
        if other_s > 0.0 and lag_s > 0.0:
            apart = abs(math.log(lag_s / other_s))
            if apart < nearest:
                best, nearest = index, apart
    if best < 0:
        return watch
    minds = list(watch.minds)
    minds[best] = replace(minds[best], evidence=minds[best].evidence + _KEPT)
    return replace(watch, minds=tuple(minds))


def read(watch: Watch, current_ma: float, measured_m: float, noise_m2: float, *, rests: bool) -> Watch:
    """Return the watch after a reading, since the last of which `current_ma` acted; the law believes the stem to rest.

    noise_m2: the variance of the mean of n readings, times n.
    """
    quiet = watch.quiet.followed_by(measured_m, noise_m2) if rests else Quiet()
    course, rest, between, same = watch.course, 0, watch.between, watch.same
    if course is None:
        between, same = joined(between, same, current_ma, measured_m)
    else:
        course, rest = course.followed_by(current_ma, measured_m), watch.rest + 1 if rests else 0
    watch = Watch(
        watch.minds, quiet, course, rest, between, same, watch.work, watch.waiting, watch.unmoved, watch.explained
    )
    if course is None or (rest < _LONGEST_REST and not course.is_too_long):
        return watch
    return _ended(watch, course, noise_m2)


def pushed(watch: Watch, direction: float, noise_m2: float, *, is_probe: bool = False) -> Watch:
    """Return the watch in whose cycle the law pushes the stem in `direction` (±1); `is_probe` where it holds it."""
    quiet = watch.quiet
    is_first = watch.minds[0].pressure_ma is None and watch.work is None and not watch.waiting
    if quiet.readings < (1 if is_first else _QUIET):
        # where the stem rests is not known: this push belongs to the course before
        return watch
    if watch.course is not None:
        watch = _ended(watch, watch.course, noise_m2)
    course = Course(quiet.mean_m, noise_m2 / quiet.readings, direction, is_probe=is_probe)
    return replace(watch, course=course, rest=0, quiet=Quiet())


def cut(watch: Watch, noise_m2: float) -> Watch:
    """Return the watch before a reading since the last of which other currents may have acted than was commanded.

    A command of ours was late, or a reading was lost: it is no evidence of the actuator. The course ends before it.
    """
    if watch.course is None:
        return watch
    unmoved = watch.unmoved
    watch = _ended(watch, watch.course, noise_m2)
    return watch if watch.unmoved <= unmoved else replace(watch, unmoved=unmoved)


def worked(nominal: Nominal, watch: Watch, period_s: float) -> Watch:
    """Return the watch after the work of one cycle at rest."""
    work = watch.work
    if work is None:
        if not watch.waiting:
            return watch
        work, watch = begun_work(watch.minds, watch.waiting[0]), replace(watch, waiting=watch.waiting[1:])
    minds, left = continued_work(nominal, watch.minds, work, period_s, _BUDGET)
    if left is not None:
        return replace(watch, minds=minds, work=left)
    explained = watch.explained + 1
    watch = replace(watch, minds=minds, work=None, explained=explained)
    if explained < _ENOUGH or watch.leader is not None:
        return watch
    return replace(watch, minds=minds[:1], waiting=()) if explained == _MOST or _is_hopeless(minds) else watch


def _is_hopeless(minds: tuple[Mind, ...]) -> bool:
    """Whether no other actuator than the believed one is likely enough to be looked for any longer."""
    for mind in minds[1:]:
        lead = mind.evidence - minds[0].evidence
        if lead > (-_BEHIND if mind.candidate.lag_s > _LEAST_S else _AHEAD):
            return False
    return True


def _ended(watch: Watch, course: Course, noise_m2: float) -> Watch:
    """Return the watch after the course: it waits for its explanation, or counts as time before the next one.

    Push after push that fails tells the same; so does a course that is too long.
    """
    if not course.pieces:
        return replace(watch, course=None, rest=0)
    finished = Finished(course, watch.between, noise_m2)
    unmoved = 0 if finished.has_moved else watch.unmoved + 1
    waiting = watch.waiting
    if (unmoved > _MOST_UNMOVED and not course.is_probe) or course.is_too_long:
        between = (*watch.between, *course.pieces)[-MOST_PIECES + 1 :]
        return replace(watch, course=None, rest=0, between=between, same=course.same, unmoved=unmoved)
    waiting = (*waiting, finished)
    if len(waiting) > _MOST_WAITING:
        waiting = (waiting[0].before(waiting[1]), *waiting[2:])
    return replace(watch, course=None, rest=0, between=(), same=0, waiting=waiting, unmoved=unmoved)
