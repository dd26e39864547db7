"""What the law `nmpc` does with a reading of the resting stem. Pure.

The reading may decide whether the last push freed the stem, show that the stem has moved by itself, or show where the
last move ended.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.laws.nmpc.breakaway import breakaway_lesson
from positioner.laws.nmpc.filter import as_one_more_m2, average, believed_m, spread_of
from positioner.laws.nmpc.memory import NmpcMemory, report
from positioner.laws.nmpc.verification import ended, verify
from positioner.laws.pushes import MOST_FAILED
from positioner.values import replace

if TYPE_CHECKING:
    from positioner.laws.law import Estimate, Observation
    from positioner.laws.nmpc.filter import AdaptiveFilter, Resting
    from positioner.laws.nmpc.settings import NmpcSettings, VerificationSettings
    from positioner.valve.stiction import LearnedSample


def update_at_rest(
    settings: NmpcSettings,
    filtered: AdaptiveFilter,
    table_cell_m: float,
    memory: NmpcMemory,
    before: Resting,
    observation: Observation,
    variance_m2: float,
    sigma_m: float,
) -> tuple[NmpcMemory, Estimate]:
    """Return the memory and the estimate of a stem that rested as `before`, after a reading with `variance_m2`.

    sigma_m is the sensor's configured σ. Only a move that has certainly happened teaches where and how it stopped.
    """
    own, monitor = settings.watch, memory.monitor
    noise_m2 = monitor.noise.of_reading * sigma_m * sigma_m
    hidden_m2 = monitor.resolution.hidden_m2(noise_m2)
    measured_m = believed_m(before.x, before.variance_m2, observation.measured_m, noise_m2 + hidden_m2)
    monitor = monitor.with_reading(own, before, measured_m, variance_m2 + hidden_m2, sigma_m)
    alone_m2, variance_m2 = variance_m2 + hidden_m2, as_one_more_m2(before, variance_m2, hidden_m2)
    after = average(before, measured_m, variance_m2)
    monitor, after, decided = verify(
        own, monitor, before, after, observation.measured_m, variance_m2, noise_m2 + hidden_m2, alone_m2
    )
    if monitor.finds_unexpected_move(own):
        # begin the average anew from where the innovations point
        scatter_m2 = monitor.scatter_m2(own, alone_m2)
        shift_m = monitor.drift * math.sqrt(before.variance_m2 + scatter_m2)
        spread = spread_of(before)
        after = filtered.at_rest(before.x + shift_m, shift_m * shift_m + scatter_m2, before.load, spread)
        monitor = replace(monitor.at_new_place(), landing=None)
    landed: tuple[LearnedSample, ...] = ()
    if monitor.landing is not None and monitor.verification is None and after.sigma_m < settings.landing_sigma_m:
        landed, monitor = monitor.landing.samples(after), replace(monitor, landing=None)
    tried, pushes = memory.monitor.verification, memory.pushes
    if tried is not None and (decided is not None or (monitor.verification is None and tried.has_failed(after))):
        origin, moved = tried.origin, decided is not None and decided.moved
        pushes = pushes.after_push(moved=moved, time_s=observation.time_s, rest_m=origin.x, sigma_m=origin.sigma_m)
        if pushes.failed == MOST_FAILED and tried.was_expected:
            # the estimate of the load must be wrong: begin again with the configured one
            after = filtered.at_rest(after.x, after.variance_m2, filtered.nominal, filtered.prior_sigmas())
    memory = replace(memory, stem=after, monitor=monitor, pushes=pushes)
    if decided is None:
        return memory, report(after, *landed)
    static_n = monitor.ratio * after.load.friction_n
    push = breakaway_lesson(
        filtered.model, table_cell_m, decided.origin.x, decided.direction, after.load.spring_n_per_m, static_n
    )
    stop = (decided.stop,) if decided.moved and decided.stop is not None else ()
    return memory, report(after, *stop, *landed, push)


def without_trial(
    settings: VerificationSettings, memory: NmpcMemory, here: Resting, time_s: float
) -> tuple[NmpcMemory, Resting]:
    """Return the memory for a move that begins at `time_s`, and where it begins: at the likelier place of the stem.

    A trial that is still open ends by its evidence. A push that has probably failed counts as failed.
    """
    tried, pushes = memory.monitor.verification, memory.pushes
    if tried is None:
        return memory, here
    origin, has_failed = tried.origin, tried.has_failed(here)
    if tried.evidence < 0.0 or has_failed:
        pushes = pushes.after_push(moved=False, time_s=time_s, rest_m=origin.x, sigma_m=origin.sigma_m)
    memory = replace(memory, monitor=ended(settings, memory.monitor, tried), pushes=pushes)
    # a push at the limit of the current that moved nothing says nothing of the load it was planned with
    is_unmoved = tried.evidence < 0.0 or (has_failed and not tried.was_expected)
    return memory, origin if is_unmoved else here
