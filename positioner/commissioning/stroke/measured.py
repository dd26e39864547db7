"""What the record of a stroke test holds: breakaways, the coast, where the stem rested. Pure.

A breakaway is found in the record afterwards: a stem is seen to move some time after it does, because of the noise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from positioner.commissioning.loop_branches import pressures_ma
from positioner.commissioning.readings import filled, smooth
from positioner.commissioning.record import Kind, stretch
from positioner.commissioning.stroke.memory import Phase

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from positioner.commissioning.record import Stretch
    from positioner.commissioning.stroke.memory import Moved, StrokeMemory
    from positioner.commissioning.stroke.plan import Plan
    from positioner.valve.parameters import ValveParameters

    Array = NDArray[np.float64]

_POINTS = 400
_SMOOTH_S = 0.05
_SLID_S = 0.3
_REST_OF_COAST = 0.3
_SLOWEST_S = 60.0
_SHORTEST_S = 0.05
_FEWEST = 4
_OTHER_SPEED, _OTHER_SCATTER, _UNEVEN_OF_STROKE = 0.4, 1.5, 0.02
_FASTEST = 1.15
"""A stem that goes on faster than it slid does so by a jump, and shows no lag."""
_HALVINGS = 60


@dataclass(frozen=True, slots=True)
class Record:
    """All samples of a test, shape (samples,) each, and the first and the last sample of each phase.

    smooth_m: the mean reading over 50 ms; a lost one counts as the one before. A phase that came twice is the first.
    """

    whole: Stretch
    measured_m: Array
    smooth_m: Array
    phases: dict[Phase, tuple[int, int]]
    period_s: float

    @classmethod
    def of(cls, memory: StrokeMemory, period_s: float) -> Record:
        """Return the record of a test."""
        phases: dict[Phase, tuple[int, int]] = {}
        following = [*(begin for _, begin in memory.began[1:]), memory.samples]
        for (phase, begin), end in zip(memory.began, following, strict=True):
            phases.setdefault(phase, (begin, end))
        whole = stretch(memory.trail, Kind.STROKE)
        measured_m = np.asarray(whole.measured_m)
        smooth_m = smooth(filled(measured_m), max(round(_SMOOTH_S / period_s), 1))
        return cls(whole, measured_m, smooth_m, phases, period_s)

    @property
    def lasted_s(self) -> float:
        """The length of the record in s."""
        return len(self.measured_m) * self.period_s

    def trace(self) -> tuple[tuple[float, float, float], ...]:
        """Return time in s, mean reading in m and current in mA of some samples, at equal distances."""
        every = -(-len(self.measured_m) // _POINTS)
        return tuple(
            (round(number * self.period_s, 6), float(self.smooth_m[number]), self.whole.applied_ma[number])
            for number in range(0, len(self.measured_m), every)
        )

    def furthest_m(self, plan: Plan) -> float:
        """Return the place in m that is farthest from the start, by means that leave little of the noise."""
        width = max(round(3.0 * max(plan.smoothing_s, _SMOOTH_S) / self.period_s), 1)
        return plan.start_m + plan.way * float(
            np.max(plan.way * (smooth(filled(self.measured_m), width) - plan.start_m))
        )

    def rested_m(self, phase: Phase) -> float:
        """Return the mean reading in m in the second half of a phase, NaN where there was none."""
        begin, end = self.phases.get(phase, (0, 0))
        readings = self.measured_m[(begin + end) // 2 : end]
        return float(np.nanmean(readings)) if np.any(~np.isnan(readings)) else math.nan

    def phase_s(self, phase: Phase) -> float:
        """Return how long a phase lasted in s, NaN where there was none."""
        begin, end = self.phases.get(phase, (0, 0))
        return (end - begin) * self.period_s if end > begin else math.nan


def onset_of(record: Record, moved: Moved, rest_m: float) -> int:
    """Return the sample of a breakaway: where the sum of the deviations from half of the motion is smallest."""
    begin = record.phases[moved.phase][0]
    end = min(moved.sample + max(round(_SMOOTH_S / record.period_s), 2), len(record.measured_m))
    gone_m = np.nan_to_num(record.measured_m[begin:end] - rest_m)
    seen_m = float(record.smooth_m[min(moved.sample, len(record.smooth_m) - 1)]) - rest_m
    sums = np.cumsum(math.copysign(1.0, seen_m) * gone_m - 0.5 * abs(seen_m))
    return min(begin + int(np.argmin(sums)) + 1, end - 1)


def breakaway_n(record: Record, valve: ValveParameters, plan: Plan, moved: Moved, lag_s: float) -> float:
    """Return the force in N, beyond that of the spring, that freed the stem; `lag_s` replaces the configured lag."""
    if not math.isnan(lag_s):
        slow = replace(valve.actuator, fill_time_constant_s=lag_s, vent_time_constant_s=lag_s)
        valve = replace(valve, actuator=slow)
    rest_m = plan.start_m if moved.phase is Phase.OUT else record.rested_m(Phase.PAUSE)
    pressure_ma = float(pressures_ma(record.whole, valve, record.period_s)[onset_of(record, moved, rest_m)])
    return valve.force_gain_n_per_ma * abs(pressure_ma - plan.balance_ma(rest_m))


def jumped_m(record: Record, plan: Plan, moved: Moved) -> float:
    """Return how far in m the stem jumped at its breakaway: where its steady sliding would have begun."""
    onset = onset_of(record, moved, plan.start_m)
    end = record.phases[Phase.OUT][1]
    begin = onset + max(round(3.0 * plan.lag_s / record.period_s), 2)
    if begin + 2 > end:
        return math.nan
    slid_s = (np.arange(begin, end) - onset + 0.5) * record.period_s
    gone_m = plan.way * (record.measured_m[begin:end] - plan.start_m)
    return float(np.nanmean(gone_m - plan.speed_m_per_s * (slid_s - plan.lag_s)))


def lag_s(record: Record, plan: Plan, out: Moved | None) -> float:
    """Return the time constant in s with which the sliding stem follows the current, NaN where nothing shows it.

    When the current is held, a stem that slides at v goes on for v·τ·(1 - exp(-t/τ)).
    """
    begin, end = record.phases.get(Phase.COAST, (0, 0))
    if out is None or (end - begin) * record.period_s < _SHORTEST_S:
        return math.nan
    onset = onset_of(record, out, plan.start_m)
    from_ = max(begin - round(_SLID_S / record.period_s), onset + 1)
    gone_m = plan.way * (record.measured_m - plan.start_m)
    early_s: Array = (begin - 0.5 - np.arange(from_, begin, dtype=np.float64)) * record.period_s
    began_m = gone_m[from_:begin] + plan.speed_m_per_s * early_s
    if len(early_s) < _FEWEST or not _steady(began_m, early_s, plan):
        return math.nan
    last = max(begin, end - max(round(_REST_OF_COAST * (end - begin)), 1))
    held_s = (0.5 * (last + end) - begin) * record.period_s
    way_s = float(np.nanmean(gone_m[last:end]) - np.nanmean(began_m)) / plan.speed_m_per_s
    return _time_constant_s(way_s, held_s) if way_s < _FASTEST * held_s else math.nan


def _steady(left_m: Array, early_s: Array, plan: Plan) -> bool:
    """Return whether the stem slid at its expected speed, without jumps: without it, its place does not change."""
    known = ~np.isnan(left_m)
    times, places = early_s[known] - early_s[known].mean(), left_m[known] - left_m[known].mean()
    squares = float(times @ times)
    slope = float(times @ places) / squares
    scatter_m = float(np.std(places - slope * times))
    slides = abs(slope) < _OTHER_SPEED * plan.speed_m_per_s + 3.0 * plan.sigma_m / math.sqrt(squares)
    return slides and scatter_m < _OTHER_SCATTER * plan.sigma_m + _UNEVEN_OF_STROKE * plan.aim_m


def _time_constant_s(way_s: float, held_s: float) -> float:
    """Return τ in s with τ·(1 - exp(-held_s/τ)) = way_s; 0 for no way, and 60 s where none is so long."""
    if way_s <= 0.0:
        return 0.0
    low_s, high_s = 0.0, _SLOWEST_S
    for _ in range(_HALVINGS):
        middle_s = 0.5 * (low_s + high_s)
        if middle_s * (1.0 - math.exp(-held_s / middle_s)) < way_s:
            low_s = middle_s
        else:
            high_s = middle_s
    return 0.5 * (low_s + high_s)
