"""The error to expect of a law on a valve, and whether its period is too long for it. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.laws.nmpc.lagged.valve import is_lagged
from positioner.reach.case import Case
from positioner.reach.small_moves import smallest_jump, smallest_push_m

if TYPE_CHECKING:
    from positioner.config.schema import Configuration

_LOST = 0.3
"""Of the natural jump: the mean error where the slip is over before its second reading, as benches show it."""
_WITHOUT_LAG = 0.15
"""Of the natural jump: the mean error of the paper's law, which knows no lag, on a valve that has one."""
_TOO_LONG, _OF_SPAN = 0.5, 0.0025
"""A period is too long where a push of one is beyond this part of the natural jump; of the span for the paper's law."""
_PAPER = ("paper", "paper-plain")


def natural_jump_m(case: Case) -> float:
    """Return (F_s - F_c)/K in m: the slip under a pressure that is held."""
    return (case.valve.static_friction_n - case.valve.coulomb_friction_n) / case.valve.spring_rate_n_per_m


def averaging_of(case: Case) -> tuple[float, int]:
    """Return σ of the average of which the law decides in m, and its readings."""
    wanted = case.sigma_m / (case.settings.lagged.certain_part * case.tolerance_m)
    samples = max(math.ceil(wanted * wanted), 1)
    return case.sigma_m / math.sqrt(samples), samples


def mean_error_m(case: Case, landing_m: float, push_m: float) -> float:
    """Return the mean error of the law `nmpc`, in m.

    Landings with a standard deviation σ are repeated until one is within the tolerance, which leaves E|e| of a normal
    distribution that is cut off there: σ √(2/π) (1 - e^(-t²/2σ²))/erf(t/√2σ). Where one period of a push is no small
    part of a slip, the law sees too little of it.
    """
    tolerance_m, jump_m = case.tolerance_m, natural_jump_m(case)
    sigma_m = math.hypot(averaging_of(case)[0], landing_m)
    left_m = tolerance_m / 2.0
    if is_lagged(case.valve) and sigma_m > 0.0:
        ratio = tolerance_m / sigma_m
        left_m = (
            sigma_m * math.sqrt(2.0 / math.pi) * -math.expm1(-ratio * ratio / 2.0) / math.erf(ratio / math.sqrt(2.0))
        )
    unseen = min(push_m / jump_m, 1.0) if jump_m > 0.0 else 0.0
    return math.hypot(left_m, _LOST * jump_m * unseen * unseen * unseen)


def in_words(configuration: Configuration) -> tuple[str, bool]:
    """Return the error to expect of the configured law in one line, empty if unknown, and whether the law fits."""
    name, case = configuration.control.law, Case.of(configuration)
    push_m = max(smallest_push_m(case, direction) for direction in (1.0, -1.0))
    period = f"{case.period_s * 1e3:g} ms"
    if name in _PAPER:
        if is_lagged(case.valve):
            lost = _percent(_WITHOUT_LAG * natural_jump_m(case), case)
            return f"about {lost}: the law {name} knows no lag, and this valve has one; take nmpc", False
        if push_m <= _OF_SPAN * case.valve.span_m:
            return "", True
        why = (
            f"{period} are too long for the law {name}: in one period a push moves the stem so far; take nmpc, or less"
        )
        return f"above {_percent(push_m, case)}: {why}", False
    if name != "nmpc":
        return "", True
    landing_m = max(smallest_jump(case, direction).landing_m for direction in (1.0, -1.0))
    error = f"{_percent(mean_error_m(case, landing_m, push_m), case)} on average"
    if push_m <= _TOO_LONG * natural_jump_m(case):
        return error, True
    share = f"{push_m * 1e3:.2g} of the {natural_jump_m(case) * 1e3:.2g} mm of its natural jump"
    why = f"{period} are too long for this valve: in one period it slips {share}; {_fitting_ms(case):g} ms would do"
    return f"{error}: {why}", False


def _fitting_ms(case: Case) -> float:
    """Return the longest usual sample period in ms that is short enough."""
    for period_ms in _USUAL_MS:
        shorter = Case(
            case.valve, case.estimator, case.settings, period_ms / 1e3, case.delay_s, case.low_ma, case.high_ma
        )
        if max(smallest_push_m(shorter, direction) for direction in (1.0, -1.0)) <= _TOO_LONG * natural_jump_m(case):
            return period_ms
    return _USUAL_MS[-1]


def _percent(error_m: float, case: Case) -> str:
    percent = 100.0 * error_m / case.valve.span_m
    return f"{percent:.{max(1 - math.floor(math.log10(max(percent, 1e-3))), 0)}f} % of span"


_USUAL_MS = (50.0, 20.0, 10.0, 5.0, 2.0, 1.0, 0.5, 0.2, 0.1)
