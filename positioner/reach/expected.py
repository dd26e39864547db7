"""The error and the corrections to expect, and whether a period or a law does not fit a valve. Pure.

How well a move ends depends on what its readings have shown of friction and lag, and a correction is made where it
pays: so error and first landing are taken from closed loops, as a part of the span that is always left and one of the
noise (`python -m benchmarks.reach_durations`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from positioner.inputs.durations import duration
from positioner.reach.case import Case
from positioner.reach.moves import SETTLED_OF_SPAN, durations, slip_s, smallest_push_m

if TYPE_CHECKING:
    from positioner.config.schema import Configuration

_OF_SPAN, _OF_NOISE = 0.0003, 0.13
"""The mean error: a part of the span, and of σ of a reading, as a root of squares."""
_FIRST_OF_SPAN, _FIRST_OF_NOISE = 0.001, 0.6
"""σ of the end of a first move, likewise."""
_JUDGED_S, _JUDGED_READINGS, _WAYS = 0.3, 20.0, 2.0
"""A correction: the rest before it is judged for so long and by so many readings; then a way there and one back."""
_WITHOUT_LAG = 0.15
"""Of the natural jump: the mean error of the paper's law, which knows no lag, on a valve that has one."""
_PUSH_OF_SPAN = 0.0025
"""A period is too long for the paper's law where a push of one moves the stem by more than this part of the span."""
_PAPER = ("paper", "paper-plain")


@dataclass(frozen=True, slots=True)
class Corrections:
    """first_m: σ of the end of a first move; share: of them that are not within 1 % of span; correction_s: of each."""

    first_m: float
    share: float
    correction_s: float

    def mean_s(self, first_s: float) -> float:
        """Return the mean duration until the stem is within 1 % of span, if the first move takes `first_s`."""
        return first_s + self.share * self.correction_s


def corrections(case: Case) -> Corrections:
    """Return how many first moves need a correction, and what it adds."""
    near_m = SETTLED_OF_SPAN * case.valve.span_m
    first_m = math.hypot(_FIRST_OF_SPAN * case.valve.span_m, _FIRST_OF_NOISE * case.sigma_m)
    share = math.erfc(near_m / (math.sqrt(2.0) * first_m))
    judged_s = max(_JUDGED_S, _JUDGED_READINGS * case.period_s)
    return Corrections(first_m, share, judged_s + _WAYS * durations(case, case.belief.jump_m + near_m).law_s)


def mean_error_m(case: Case) -> float:
    """Return the mean error of the law `nmpc`, in m."""
    if is_too_slow(case):
        return case.belief.jump_m
    return math.hypot(_OF_SPAN * case.valve.span_m, _OF_NOISE * case.sigma_m)


def is_too_slow(case: Case) -> bool:
    """Return whether a slip is nearly over before the next reading shows it, and no pressure that lags slows it."""
    return case.valve.is_immediate and case.period_s > slip_s(case)


def in_words(configuration: Configuration) -> tuple[str, str]:
    """Return the error to expect of the configured law, empty if unknown, and why the law does not fit, or nothing."""
    name, case = configuration.control.law, Case.of(configuration)
    period = duration(case.period_s)
    if name in _PAPER:
        return _paper_in_words(name, case)
    if name != "nmpc":
        return "", ""
    error = _percent(mean_error_m(case), case)
    if is_too_slow(case):
        why = f"{period} are too long for this valve, whose slip is nearly over after {duration(slip_s(case), 2)}"
        return f"about {error}", f"{why}; take a shorter period"
    return f"{error} on average", ""


def _paper_in_words(name: str, case: Case) -> tuple[str, str]:
    if not case.valve.is_immediate:
        lost = _percent(_WITHOUT_LAG * case.belief.jump_m, case)
        return f"about {lost}", f"the law {name} knows no lag, and this valve has one; take nmpc"
    push_m, period = max(smallest_push_m(case, s) for s in (1.0, -1.0)), duration(case.period_s)
    if push_m <= _PUSH_OF_SPAN * case.valve.span_m:
        return "", ""
    why = f"{period} are too long for the law {name}: in one period a push moves the stem so far; take nmpc, or less"
    return f"above {_percent(push_m, case)}", why


def _percent(error_m: float, case: Case) -> str:
    percent = 100.0 * error_m / case.valve.span_m
    return f"{percent:.{max(1 - math.floor(math.log10(max(percent, 1e-3))), 0)}f} % of span"
