"""Whether the stem stays away from its setpoint: an error beyond a limit, without progress, for too long. Pure.

The reason may be missing air, a stuck stem, a reversed action, a wrong sensor, another valve than the configured one or
a law that gives up. In each case the host sees a lasting error, and the status must not be *good*: NAMUR NE 107 calls a
deviation from the set value that an actuator finds by its own diagnosis *out of specification*. Control continues.

A stem on its way is no deviation, however long the stroke: each step of the stem towards the setpoint starts the time
again. A setpoint is reported as unreachable, and from a smaller error on, where the loop current cannot reach it by the
believed spring and friction, or where all the current has been seen not to move the stem (`full_push`).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.cycle.full_push import NO_PUSH, FullPush, track_push
from positioner.values import dataclass, replace
from positioner.wire.messages import Cause

if TYPE_CHECKING:
    from positioner.guard.settings import GuardSettings
    from positioner.valve.parameters import ValveParameters

FILTER_S = 0.1
"""Time constant of the mean reading: it reduces a noise of 2 %, of which each value lasts for 10 ms, to 0.45 %."""
PROGRESS_OF_LIMIT = 0.2
"""A step towards the setpoint, as a part of the limit, that starts the time again; 1 % of span by default."""
UNREACHABLE_OF_LIMIT = 0.2
"""The error from an unreachable setpoint is reported beyond this part of the limit."""
RETURN_OF_LIMIT = 0.8
"""A reported error ends within this part of its limit."""


@dataclass(frozen=True, slots=True)
class Deviation:
    """What is known of the error.

    position_m: the mean reading. direction: of the setpoint from there, +1 or -1; 0 while the error is small.
    mark_m: the mean from which progress in `direction` is measured. from_m: the mean when the error became large, or at
        the last progress. waited_s: time without progress.
    cause: NONE, DEVIATION or SETPOINT_UNREACHABLE. push: with all the current.
    """

    position_m: float | None = None
    direction: int = 0
    mark_m: float = 0.0
    from_m: float = 0.0
    waited_s: float = 0.0
    cause: Cause = Cause.NONE
    push: FullPush = NO_PUSH

    def after_failed(self, pushes: int, stem_m: float) -> Deviation:
        """Return what is known after the law has found that its last `pushes` failed, and the stem is at `stem_m`."""
        return replace(self, push=self.push.after_failed(pushes, stem_m))


@dataclass(frozen=True, slots=True)
class Deviates:
    """The stem stays away from its setpoint; `why` describes what the readings show."""

    why: str

    def __str__(self) -> str:
        """One line for the log."""
        return f"deviation: {self.why}"


NO_DEVIATION = Deviation()


def track_deviation(
    settings: GuardSettings,
    valve: ValveParameters,
    known: Deviation,
    measured_m: float,
    setpoint_m: float,
    elapsed_s: float,
    sent_ma: float | None,
) -> Deviation:
    """Return the deviation from `setpoint_m` after the reading `measured_m`, which came `elapsed_s` after the last.

    `sent_ma` is the command that was in force meanwhile, None where there was none.
    """
    if settings.deviation_of_span == 0.0:
        return NO_DEVIATION
    weight = 1.0 - math.exp(-elapsed_s / FILTER_S)
    mean_m = measured_m if known.position_m is None else known.position_m + weight * (measured_m - known.position_m)
    error_m = setpoint_m - mean_m
    limit_m = settings.deviation_of_span * valve.span_m
    least_m = UNREACHABLE_OF_LIMIT * limit_m
    side = round(math.copysign(1.0, error_m))
    wanted = side if abs(error_m) > RETURN_OF_LIMIT * least_m else 0
    progress_m = PROGRESS_OF_LIMIT * limit_m
    push = track_push(settings, valve, known.push, mean_m, wanted, progress_m, sent_ma, elapsed_s)
    reachable = is_reachable(settings, valve, setpoint_m, mean_m) and not push.is_in_vain
    if reachable and known.cause is Cause.SETPOINT_UNREACHABLE:
        known = NO_DEVIATION  # another setpoint: the time starts again
    threshold_m = limit_m if reachable else least_m
    if abs(error_m) <= threshold_m * (1.0 if known.cause is Cause.NONE else RETURN_OF_LIMIT):
        return Deviation(position_m=mean_m, push=push)
    mark_m, from_m, waited_s = known.mark_m, known.from_m, known.waited_s + elapsed_s
    if side != known.direction:
        mark_m = mean_m
        from_m = mean_m if known.direction == 0 else from_m
    elif side * (mean_m - mark_m) >= progress_m:
        mark_m, from_m, waited_s = mean_m, mean_m, 0.0
    cause = known.cause
    if cause is not Cause.NONE or waited_s > settings.deviation_s:
        cause = Cause.DEVIATION if reachable else Cause.SETPOINT_UNREACHABLE
    return Deviation(mean_m, side, mark_m, from_m, waited_s, cause, push)


def is_reachable(settings: GuardSettings, valve: ValveParameters, setpoint_m: float, position_m: float) -> bool:
    """Return whether the loop current can bring a stem from `position_m` to `setpoint_m`, by the believed valve."""
    low_m, high_m = reach_m(settings, valve)
    return setpoint_m <= high_m if setpoint_m > position_m else setpoint_m >= low_m


def reach_m(settings: GuardSettings, valve: ValveParameters) -> tuple[float, float]:
    """Return how far the stem closes and how far it opens in m: where spring, friction and current balance (eq. 3)."""
    friction_ma = valve.coulomb_friction_n / valve.force_gain_n_per_ma
    metres_per_ma = valve.force_gain_n_per_ma / valve.spring_rate_n_per_m
    middle_ma = valve.balance_current_ma(0.0)
    low_m = (settings.current_low_ma + friction_ma - middle_ma) * metres_per_ma
    high_m = (settings.current_high_ma - friction_ma - middle_ma) * metres_per_ma
    return low_m, high_m


def description(settings: GuardSettings, valve: ValveParameters, known: Deviation, setpoint_m: float) -> str:
    """Return a description of the error, with the likely reason where the readings show one."""
    position_m = known.position_m if known.position_m is not None else setpoint_m
    off_m = position_m - setpoint_m
    text = f"the stem is {abs(off_m) * 1e3:.1f} mm {'below' if off_m < 0.0 else 'above'} its setpoint"
    text += f" of {setpoint_m * 1e3:.1f} mm"
    if known.cause is Cause.SETPOINT_UNREACHABLE:
        opening = off_m < 0.0
        limit = f"{settings.current_high_ma if opening else settings.current_low_ma:g} mA"
        if is_reachable(settings, valve, setpoint_m, position_m):
            spring = "stiffer" if opening else "softer"
            why = f"a {spring} spring or more friction than configured"
            return f"{text}, which is out of reach: {limit} do not move it from {position_m * 1e3:.1f} mm, by {why}"
        end_m = reach_m(settings, valve)[1 if opening else 0]
        return f"{text}, which is out of reach: {limit} {'open' if opening else 'close'} it to {end_m * 1e3:.1f} mm"
    away_m = -known.direction * (position_m - known.from_m)
    if away_m > PROGRESS_OF_LIMIT * settings.deviation_of_span * valve.span_m:
        return f"{text} and went {away_m * 1e3:.1f} mm the other way: is the action reversed?"
    return f"{text} and came no nearer for {known.waited_s:.3g} s: look at air, actuator and sensor"
