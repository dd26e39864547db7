"""The stem of a law without a model: a filtered position and its rate of change. Pure."""

from __future__ import annotations

from positioner.laws.law import Estimate
from positioner.valve.state import StemState


def smooth(before_m: float, measured_m: float, time_constant_s: float, elapsed_s: float) -> float:
    """Return the output in m of the first-order filter y_f += T / (T_f + T) (y - y_f), T_f the time constant."""
    return before_m + elapsed_s / (time_constant_s + elapsed_s) * (measured_m - before_m)


def report(position_m: float, speed_m_per_s: float) -> Estimate:
    """Return the stem as such a law sees it: never stuck, and without lessons.

    Under 2 % noise a filtered position cannot tell a stick from slow sliding. The stiction table belongs to the valve
    and outlives the law: stops and slips guessed from such a position would mislead the laws that rely on it.
    """
    return Estimate(StemState(position_m, speed_m_per_s, stuck=False, direction=-1.0 if speed_m_per_s < 0.0 else 1.0))
