"""The error to expect of a law on a valve, and whether its period is too long for it. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.inputs.durations import duration
from positioner.laws.nmpc.lagged.valve import is_lagged
from positioner.reach.case import Case, freeing_ma, slip_of
from positioner.reach.small_moves import smallest_jump, smallest_push_m

if TYPE_CHECKING:
    from positioner.config.schema import Configuration
    from positioner.reach.small_moves import Jump

_LOST_IN_NOISE = 0.25
"""Of the natural jump: the mean error behind a lag where noise hides a slip until it is nearly over; from benches."""
_WITHOUT_LAG = 0.15
"""Of the natural jump: the mean error of the paper's law, which knows no lag, on a valve that has one."""
_HIDDEN, _NOISY, _FEWEST = 0.8, 0.1, 1.5
"""Noise hides a slip where it is noticed after this part of the natural jump and in fewer periods, and σ is beyond
`_NOISY` of that jump."""
_NEARLY = 0.95
"""A slip is nearly over after this part of the natural jump; a longer period is too long."""
_OF_SPAN = 0.0025
"""A period is too long for the paper's law where a push of one moves the stem by more than this part of the span."""
_PAPER = ("paper", "paper-plain")
_LONGEST_SLIP_S = 60.0


def natural_jump_m(case: Case) -> float:
    """Return (F_s - F_c)/K in m: the slip under a pressure that is held."""
    return (case.valve.static_friction_n - case.valve.coulomb_friction_n) / case.valve.spring_rate_n_per_m


def averaging_of(case: Case) -> tuple[float, int]:
    """Return σ of the average of which the law decides in m, and its readings."""
    wanted = case.sigma_m / (case.settings.lagged.certain_part * case.tolerance_m)
    samples = max(math.ceil(wanted * wanted), 1)
    return case.sigma_m / math.sqrt(samples), samples


def mean_error_m(case: Case, jump: Jump) -> float:
    """Return the mean error of the law `nmpc`, in m; `jump` is the smallest that the readings show.

    Landings with a standard deviation σ are repeated until one is within the tolerance, which leaves E|e| of a normal
    distribution that is cut off there: σ √(2/π) (1 - e^(-t²/2σ²))/erf(t/√2σ).
    """
    if is_too_slow(case):
        return natural_jump_m(case)
    if is_too_noisy(case, jump):
        return _LOST_IN_NOISE * natural_jump_m(case)
    tolerance_m, sigma_m = case.tolerance_m, math.hypot(averaging_of(case)[0], jump.landing_m)
    if not is_lagged(case.valve) or sigma_m == 0.0:
        return tolerance_m / 2.0
    ratio = tolerance_m / sigma_m
    return sigma_m * math.sqrt(2.0 / math.pi) * -math.expm1(-ratio * ratio / 2.0) / math.erf(ratio / math.sqrt(2.0))


def is_too_slow(case: Case) -> bool:
    """Return whether a slip is nearly over before the next reading shows it."""
    return case.period_s > slip_s(case)


def is_too_noisy(case: Case, jump: Jump) -> bool:
    """Return whether noise hides a slip until it is nearly over and a single reading has shown it, behind a lag."""
    jump_m = natural_jump_m(case)
    is_hidden = jump.jump_m > _HIDDEN * jump_m and jump.noticed_s < _FEWEST * case.period_s
    return is_lagged(case.valve) and is_hidden and case.sigma_m > _NOISY * jump_m


def slip_s(case: Case) -> float:
    """Return after how long in s a slip is nearly over, under the pressure that freed the stem."""
    own, start_m = case.lagged(_SLIP_STEP_S), case.middle_m
    slip, over_m = slip_of(own, 1.0), start_m + _NEARLY * natural_jump_m(case)
    pressure_ma = freeing_ma(slip, start_m)
    x, v, t, stopped = start_m, 0.0, 0.0, False
    while not stopped and x < over_m and t < _LONGEST_SLIP_S:
        x, v, _, _, stopped = slip.after(x, v, pressure_ma, pressure_ma, pressure_ma)
        t += _SLIP_STEP_S
    return t


def in_words(configuration: Configuration) -> tuple[str, str]:
    """Return the error to expect of the configured law, empty if unknown, and why the law does not fit, or nothing."""
    name, case = configuration.control.law, Case.of(configuration)
    period = duration(case.period_s)
    if name in _PAPER:
        return _paper_in_words(name, case)
    if name != "nmpc":
        return "", ""
    jump = smallest_jump(case, 1.0)
    error = _percent(mean_error_m(case, jump), case)
    if is_too_slow(case):
        why = f"{period} are too long for this valve, whose slip is nearly over after {duration(slip_s(case), 2)}"
        return f"about {error}", f"{why}; take a shorter period"
    if is_too_noisy(case, jump):
        seen = f"{jump.jump_m * 1e3:.2g} of the {natural_jump_m(case) * 1e3:.2g} mm of its natural jump"
        why = f"at {period} the noise hides a slip for {seen}, and the lag leaves no time to brake it"
        return f"about {error}", f"{why}; take a shorter period, or a better sensor"
    return f"{error} on average", ""


def _paper_in_words(name: str, case: Case) -> tuple[str, str]:
    if is_lagged(case.valve):
        lost = _percent(_WITHOUT_LAG * natural_jump_m(case), case)
        return f"about {lost}", f"the law {name} knows no lag, and this valve has one; take nmpc"
    push_m, period = max(smallest_push_m(case, s) for s in (1.0, -1.0)), duration(case.period_s)
    if push_m <= _OF_SPAN * case.valve.span_m:
        return "", ""
    why = f"{period} are too long for the law {name}: in one period a push moves the stem so far; take nmpc, or less"
    return f"above {_percent(push_m, case)}", why


def _percent(error_m: float, case: Case) -> str:
    percent = 100.0 * error_m / case.valve.span_m
    return f"{percent:.{max(1 - math.floor(math.log10(max(percent, 1e-3))), 0)}f} % of span"


_SLIP_STEP_S = 1e-3
