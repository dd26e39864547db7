"""The counters and histograms of a valve: what is kept. Pure.

Times are whole microseconds, so that their sums are exact.
"""

from __future__ import annotations

from dataclasses import field
from typing import TYPE_CHECKING

from positioner.health.classes import DEVIATION_EDGES_PERCENT, SPAN_EDGES_PERCENT, TRAVEL_EDGES_PERCENT, empty
from positioner.values import dataclass
from positioner.wire.messages import Mode

if TYPE_CHECKING:
    from positioner.health.settings import HealthTable
    from positioner.health.turns import Turns
    from positioner.laws.estimator_settings import EstimatorSettings
    from positioner.valve.parameters import ValveParameters

SIGMAS = 4.0
"""A dead band is at least so many σ of a reading."""


@dataclass(frozen=True, slots=True)
class CounterSettings:
    """What the counters know of the valve.

    sample_period_s: time between two readings. noise_of_reading, noise_of_span: σ of a reading as fractions.
    cycle_band_of_span, travel_band_of_span: the dead bands of cycles, and of travel and changes of direction, where the
        noise is small.
    testing: a test procedure is in the place of the law. wear: by class of spans, the part of the packing's life that a
        cycle takes; empty where nobody knows.
    """

    span_m: float
    travel_min_m: float
    sample_period_s: float
    noise_of_reading: float
    noise_of_span: float
    cycle_band_of_span: float = 0.01
    travel_band_of_span: float = 0.0025
    testing: bool = False
    wear: tuple[float, ...] = ()

    def dead_band_m(self, of_span: float, position_m: float) -> float:
        """Return the dead band in m at a position: this part of the span, and at least 4 σ of a reading there."""
        sigma_m = self.noise_of_reading * abs(position_m) + self.noise_of_span * self.span_m
        return max(of_span * self.span_m, SIGMAS * sigma_m)

    def percent(self, position_m: float) -> float:
        """Return a position in percent of the span."""
        return 100.0 * (position_m - self.travel_min_m) / self.span_m


def counter_settings(
    valve: ValveParameters, estimator: EstimatorSettings, period_s: float, health: HealthTable
) -> CounterSettings:
    """Return the settings for a valve with these tables of its configuration."""
    return CounterSettings(
        span_m=valve.span_m,
        travel_min_m=valve.travel_min_m,
        sample_period_s=period_s,
        noise_of_reading=estimator.noise_of_reading,
        noise_of_span=estimator.noise_of_span,
        cycle_band_of_span=health.cycle_dead_band,
        travel_band_of_span=health.travel_dead_band,
        wear=health.wear,
    )


@dataclass(frozen=True, slots=True)
class Counters:
    """All counts since the start date.

    observed: cycles of the positioner that were counted; starts: of the positioner.
    mode_us: time in each mode, by its number; checked_us: in which a test procedure controlled the valve, which is no
        time in ACTIVE. controlled_us: time in which a law knew whether the stem sticks;
        stuck_us: in which it stuck. closed_us, near_closed_us, open_us: time at the ends of the travel.
    slips, sticks: edges between sticking and sliding. moves: that the law began. failed_pushes: pushes that
        freed nothing.
    travel_m: the way of the stem; reversals: changes of its direction; cycles: those beyond the cycle dead band.
    travel, deviation, spans: the histograms. travel_recent, deviation_recent: the classes of their last 100 samples,
        oldest first.
    anchor_m: up to where `travel_m` is counted; turns, cycle_turns: of `reversals` and `cycles`; None before the first
        reading.
    """

    observed: int = 0
    starts: int = 0
    mode_us: tuple[int, ...] = (0,) * len(Mode)
    checked_us: int = 0
    controlled_us: int = 0
    stuck_us: int = 0
    closed_us: int = 0
    near_closed_us: int = 0
    open_us: int = 0
    slips: int = 0
    sticks: int = 0
    moves: int = 0
    failed_pushes: int = 0
    travel_m: float = 0.0
    reversals: int = 0
    cycles: int = 0
    travel: tuple[int, ...] = field(default_factory=lambda: empty(TRAVEL_EDGES_PERCENT))
    deviation: tuple[int, ...] = field(default_factory=lambda: empty(DEVIATION_EDGES_PERCENT))
    spans: tuple[int, ...] = field(default_factory=lambda: empty(SPAN_EDGES_PERCENT))
    travel_recent: tuple[int, ...] = ()
    deviation_recent: tuple[int, ...] = ()
    anchor_m: float | None = None
    turns: Turns | None = None
    cycle_turns: Turns | None = None

    @property
    def total_us(self) -> int:
        """The time that was counted, in µs."""
        return sum(self.mode_us) + self.checked_us

    def full_strokes(self, span_m: float) -> float:
        """Return the travel in strokes from one end to the other and back."""
        return self.travel_m / (2.0 * span_m)
