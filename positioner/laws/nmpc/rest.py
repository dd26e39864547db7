"""What a reading of the resting stem teaches the law `nmpc`: whether the last push freed it, and what follows. Pure."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from positioner.laws.nmpc.breakaway import lesson
from positioner.laws.nmpc.filter import spread_of
from positioner.laws.nmpc.memory import NmpcMemory, report
from positioner.laws.nmpc.verification import judge, watch
from positioner.laws.pushes import MOST_FAILED

if TYPE_CHECKING:
    from positioner.laws.law import Estimate, Observation
    from positioner.laws.nmpc.filter import AdaptiveFilter, Resting
    from positioner.laws.nmpc.settings import NmpcSettings
    from positioner.valve.stiction import LearnedSample


def attend(
    settings: NmpcSettings,
    filtered: AdaptiveFilter,
    table_cell_m: float,
    memory: NmpcMemory,
    stems: tuple[Resting, Resting],
    observation: Observation,
    variance_m2: float,
    sigma_m: float,
) -> tuple[NmpcMemory, Estimate]:
    """Return the memory and the resting stem after a reading of `variance_m2` took one of `stems` to the other.

    sigma_m is the sensor's configured σ. Only a move that is sure to have happened teaches where and how it stopped.
    """
    own, measured_m, (before, after) = settings.watch, observation.measured_m, stems
    seen = watch(own, memory.watch, before, measured_m, variance_m2, sigma_m)
    seen, after, decided = judge(own, seen, before, after, measured_m, variance_m2)
    if seen.is_surprised(own):
        # begin the average anew from where the innovations point
        shift_m = seen.drift * math.sqrt(before.variance_m2 + variance_m2)
        spread = spread_of(before)
        after = filtered.at_rest(before.x + shift_m, shift_m * shift_m + variance_m2, before.load, spread)
        seen = replace(seen.elsewhere(), landing=None)
    taught: tuple[LearnedSample, ...] = ()
    if seen.landing is not None and seen.trial is None and after.sigma_m < settings.landing_sigma_m:
        taught, seen = seen.landing.samples(after), replace(seen, landing=None)
    tried, pushes = memory.watch.trial, memory.pushes
    if tried is not None and (decided is not None or (seen.trial is None and tried.has_failed(after))):
        origin, moved = tried.origin, decided is not None and decided.moved
        pushes = pushes.judged(moved=moved, time_s=observation.time_s, rest_m=origin.x, sigma_m=origin.sigma_m)
        if pushes.failed == MOST_FAILED:
            # whatever was believed of the load, it is not so
            after = filtered.at_rest(after.x, after.variance_m2, filtered.nominal, filtered.prior_sigmas())
    memory = replace(memory, stem=after, watch=seen, pushes=pushes)
    if decided is None:
        return memory, report(after, *taught)
    spring, friction_n, _ = after.load
    static_n, origin_m = seen.ratio * friction_n, decided.origin.x
    push = lesson(filtered.model, table_cell_m, origin_m, decided.direction, spring, static_n)
    stop = (decided.stop,) if decided.moved and decided.stop is not None else ()
    return memory, report(after, *stop, *taught, push)
