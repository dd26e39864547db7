"""A move that is braked, and where a rollout stops it. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.values import dataclass
from positioner.valve.rollout import Moving
from positioner.valve.state import StemState

if TYPE_CHECKING:
    from collections.abc import Sequence

    from positioner.valve.pressure import PressureState
    from positioner.valve.rollout import Rollout

LONGEST = 4000
"""Samples after which a motion is no longer computed: 4 s at 1 ms, a move behind a lag of 0.5 s."""
ARRIVED_MA = 0.05
"""So near to its level the pressure no longer frees a stem that rests: a hundredth of F_s."""


@dataclass(frozen=True, slots=True)
class Task:
    """From where to where, and with which currents: `boost_ma` frees the stem, `brake_ma` stops it, `hold_ma` holds it.

    rises_s, falls_s: lags of the pressure on its way to the first and to the second. before_ma: the current of the
    sample before. step_ma: the largest change from sample to sample.
    """

    pressure: PressureState
    start_m: float
    target_m: float
    boost_ma: float
    brake_ma: float
    hold_ma: float
    rises_s: float
    falls_s: float
    period_s: float
    before_ma: float = 0.0
    step_ma: float = math.inf

    @property
    def direction(self) -> float:
        """Of the move, ±1."""
        return 1.0 if self.target_m > self.start_m else -1.0

    def currents(self, boost_s: float) -> tuple[float, ...]:
        """Return the mean current in mA of each sample, until the pressure is where it is held; at least one."""
        peak_ma = self.boost_ma + (self.pressure.pressure_ma - self.boost_ma) * math.exp(-boost_s / self.rises_s)
        gap_ma = self.hold_ma - self.brake_ma
        over = (peak_ma - self.brake_ma) / gap_ma if abs(gap_ma) > ARRIVED_MA else 1.0
        ends_s = boost_s + (self.falls_s * math.log(over) if over > 1.0 else 0.0)
        found: list[float] = []
        for sample in range(math.ceil(ends_s / self.period_s - 1e-9)):
            begin_s, end_s = sample * self.period_s, (sample + 1) * self.period_s
            boosts_s = max(min(end_s, boost_s) - begin_s, 0.0)
            brakes_s = max(min(end_s, ends_s) - max(begin_s, boost_s), 0.0)
            holds_s = self.period_s - boosts_s - brakes_s
            total = boosts_s * self.boost_ma + brakes_s * self.brake_ma + holds_s * self.hold_ma
            found.append(total / self.period_s)
        return tuple(found) or (self.hold_ma,)


@dataclass(frozen=True, slots=True)
class Stop:
    """Where a stem stops; in which sample it was freed, -1 if not; whether it then rests; the pressure's peak in mA.

    ends: in how many samples it has stopped.
    """

    position_m: float
    freed: int
    is_held: bool
    peak_ma: float
    ends: int = 0


def stop_of(rollout: Rollout, task: Task, currents: tuple[float, ...], begun: Moving | None = None) -> Stop:
    """Return where the stem stops under these currents; begun: where it is now, at rest at the start if None."""
    direction, static_ma = task.direction, rollout.numbers.static_ma
    moving = begun or Moving(task.pressure, StemState(task.start_m, 0.0, True, direction))
    peak_ma, freed, stopped = direction * moving.pressure.pressure_ma, -1 if moving.stem.stuck else 0, False
    all_sent, current_ma, ends = len(currents) + rollout.pressure.waiting // rollout.steps, task.before_ma, 0
    for sample in range(LONGEST):
        wanted_ma = currents[sample] if sample < len(currents) else task.hold_ma
        current_ma = min(max(wanted_ma, current_ma - task.step_ma), current_ma + task.step_ma)
        moving = rollout.after(moving, current_ma)
        stem, pressure_ma = moving.stem, moving.pressure.pressure_ma
        peak_ma = max(peak_ma, direction * pressure_ma)
        if stopped and not stem.stuck:
            return Stop(stem.position_m, freed, False, direction * peak_ma, ends)
        if freed < 0 and stem.position_m != task.start_m:
            freed = sample
        if freed >= 0 and stem.stuck and not stopped:
            stopped, ends = True, sample + 1
        if stem.stuck and sample >= all_sent and abs(pressure_ma - task.hold_ma) < min(ARRIVED_MA, static_ma):
            return Stop(stem.position_m, freed, True, direction * peak_ma, ends)
    return Stop(moving.stem.position_m, freed, False, direction * peak_ma, ends)


def beyond_m(stop: Stop, task: Task) -> float:
    """Return how far beyond its target a stem stops; one that is not freed is short of it."""
    return task.direction * (stop.position_m - task.target_m) if stop.freed >= 0 else -math.inf


def limited(task: Task, currents: Sequence[float], samples: int) -> tuple[float, ...]:
    """Return these currents, then those that hold the stem, no two of which differ by more than the largest change.

    Of so many samples, or of all until the stem is held.
    """
    found, current_ma, sample = list[float](), task.before_ma, 0
    while sample < max(samples, len(currents)) or abs(current_ma - task.hold_ma) > task.step_ma:
        wanted_ma = currents[sample] if sample < len(currents) else task.hold_ma
        current_ma = min(max(wanted_ma, current_ma - task.step_ma), current_ma + task.step_ma)
        found.append(current_ma)
        sample += 1
    return tuple(found)
