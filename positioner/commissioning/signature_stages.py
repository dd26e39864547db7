"""The experiment of `signature`: slow strokes over the range of the current, and breakaways along the travel. Pure.

The first strokes bring the stem onto the loop, wherever it was, and are not recorded. Strokes show spring and sliding
friction; only a breakaway from rest shows the static friction. A stroke is fast enough for a steadily sliding stem: its
speed is twice the Stribeck velocity at least. Where the friction changes along the travel faster than the spring's
force, a stem slides by stick-slip all the same. So quick strokes follow, in which it slides through; a stem with strong
damping needs none, and would hide its friction in them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.commissioning.experiment import Experiment
from positioner.commissioning.homing import Return
from positioner.commissioning.release import Release
from positioner.commissioning.stages import Rest, SlideUp, Stroke

if TYPE_CHECKING:
    from positioner.commissioning.procedure import ProcedureLimits
    from positioner.valve.parameters import ValveParameters

_LEAST_MA_PER_S = 1.0
_STRIBECK_VELOCITIES = 2.0
_REST_S = 3.0
_APPROACH_MA_PER_S = 4.0
_LOOPS = 2
_QUICK_MA_PER_S, _QUICKER = 8.0, 2.0
_MOST_VISCOUS = 0.05
"""The viscous part of the sliding friction in a quick stroke, at most."""
_PLACES = (0.1, 0.3, 0.5, 0.7, 0.9)
"""Of the way between the lowest and the highest place that the strokes reached."""


def signature_experiment(
    valve: ValveParameters, limits: ProcedureLimits, period_s: float, rate_ma_per_s: float = 0.0
) -> Experiment:
    """Return the experiment for the valve as it is configured, within the limits; rate 0 is the slowest that slides."""
    low_ma, high_ma, most = limits.current_low_ma, limits.current_high_ma, limits.rate_ma_per_s
    slowest_m_per_s = _STRIBECK_VELOCITIES * valve.stribeck_velocity_m_per_s
    least = max(slowest_m_per_s * valve.spring_rate_n_per_m / valve.force_gain_n_per_ma, _LEAST_MA_PER_S)
    rate = min(rate_ma_per_s or least, most)
    approach = [Stroke(to_ma, min(_APPROACH_MA_PER_S, most), records=False) for to_ma in (low_ma, high_ma, low_ma)]
    strokes = [Stroke(to_ma, rate, shows_line=number == 0) for number in range(_LOOPS) for to_ma in (high_ma, low_ma)]
    quick = min(_quick_ma_per_s(valve), most)
    if quick >= _QUICKER * rate:
        strokes += [Stroke(to_ma, quick) for _ in range(_LOOPS) for to_ma in (high_ma, low_ma)]
    breakaways = [stage for part in _PLACES for stage in (SlideUp(part), Release(1.0, 0.0), Release(-1.0, 0.0))]
    stages = (Rest(_REST_S), *approach, *strokes, *breakaways, Return())
    return Experiment(valve, limits, period_s, stages, "signature")


def _quick_ma_per_s(valve: ValveParameters) -> float:
    """Return the rate of the quick strokes, at which viscous friction is still a small part of the whole."""
    most_n = _MOST_VISCOUS * valve.coulomb_friction_n
    speed_m_per_s = most_n / max(valve.viscous_friction_n_s_per_m, 1e-9)
    return min(speed_m_per_s * valve.spring_rate_n_per_m / valve.force_gain_n_per_ma, _QUICK_MA_PER_S)
