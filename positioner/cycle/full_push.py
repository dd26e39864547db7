"""Whether all the current that there is does not move the stem towards its setpoint. Pure.

A valve with a stiffer spring or more friction than configured cannot be opened as far as believed. Only a push with all
the current shows this: the stem stays where it is. The current counts as it arrives at the diaphragm, behind the
configured lags. Where the configured valve would have much force to spare, no setpoint is out of reach: then the stem
is jammed, or has no air.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.values import dataclass
from positioner.valve.actuator import left_of_lag

if TYPE_CHECKING:
    from positioner.guard.settings import GuardSettings
    from positioner.valve.parameters import ValveParameters

LONG_ENOUGH_S = 0.3
"""A stem that does not move while all the current acts for so long is held: thrice the time constant of the mean."""
OFTEN_ENOUGH = 2
"""A stem that a law has pushed so often in vain is held; its pushes may be much shorter than `LONG_ENOUGH_S`."""
NEAR_OF_RANGE = 0.02
"""A current is at its limit within this part of the range of currents."""
OFF = 1.3
"""A spring, or a friction, may be off by this factor; more is a fault of the valve."""


@dataclass(frozen=True, slots=True)
class FullPush:
    """What is known of pushes with all the current.

    current_ma: what arrives at the diaphragm, None before the first command. direction: of the setpoint, ±1, or 0 while
    the error is small. from_m: where the stem was at its last progress; seconds: for how long it was pushed fully since
    then; failed: pushes that the law counts as failed since then. was_full: whether the present one is a full one.
    """

    current_ma: float | None = None
    direction: int = 0
    from_m: float = 0.0
    seconds: float = 0.0
    failed: int = 0
    was_full: bool = False

    @property
    def is_in_vain(self) -> bool:
        """Whether all the current does not move the stem towards its setpoint."""
        return self.seconds >= LONG_ENOUGH_S or self.failed >= OFTEN_ENOUGH

    def after_failed(self, pushes: int, stem_m: float) -> FullPush:
        """Return the push after the law has found that its last `pushes` in a row failed, and the stem is at `stem_m`.

        The mean reading, which comes later, makes no progress on its way there.
        """
        if not self.was_full:
            return self
        opens = self.direction > 0  # pragma: no mutate - a full push has a direction
        from_m = max(self.from_m, stem_m) if opens else min(self.from_m, stem_m)
        return FullPush(self.current_ma, self.direction, from_m, self.seconds, pushes)


NO_PUSH = FullPush()


def track_push(
    settings: GuardSettings,
    valve: ValveParameters,
    known: FullPush,
    mean_m: float,
    direction: int,
    progress_m: float,
    sent_ma: float | None,
    elapsed_s: float,
) -> FullPush:
    """Return the push after the mean reading `mean_m`, of a stem that is wanted in `direction` (±1; 0: here).

    A way of `progress_m` in this direction is progress. `sent_ma` was in force for `elapsed_s`; None: before the first
    command.
    """
    if sent_ma is None:
        return NO_PUSH
    current_ma = _arrived_ma(valve, known.current_ma, sent_ma, elapsed_s)
    low_ma, high_ma = settings.current_low_ma, settings.current_high_ma
    opens = direction > 0  # pragma: no mutate - without a direction no push is full
    limit_ma = high_ma if opens else low_ma
    is_full = direction != 0 and abs(limit_ma - current_ma) <= NEAR_OF_RANGE * (high_ma - low_ma)
    is_full = is_full and may_hold(valve, mean_m, direction, limit_ma)
    if direction != known.direction:
        return FullPush(current_ma, direction, mean_m, was_full=is_full)
    was_full = is_full or known.was_full
    if direction * (mean_m - known.from_m) >= progress_m:
        return FullPush(current_ma, direction, mean_m, was_full=was_full)
    seconds = known.seconds + (elapsed_s if is_full else 0.0)
    return FullPush(current_ma, direction, known.from_m, seconds, known.failed, was_full)


def may_hold(valve: ValveParameters, position_m: float, direction: int, current_ma: float) -> bool:
    """Return whether a valve with a spring or a friction that is off by `OFF` holds the stem against this current."""
    push_n = valve.force_gain_n_per_ma * current_ma
    spring_n, friction_n = valve.bench_set_n + valve.spring_rate_n_per_m * position_m, valve.static_friction_n
    opens = direction > 0  # pragma: no mutate - it has a direction
    other_spring_n = spring_n * OFF if opens else spring_n / OFF
    by_spring, by_friction = direction * (push_n - other_spring_n), direction * (push_n - spring_n)
    return by_spring <= friction_n or by_friction <= OFF * friction_n


def _arrived_ma(valve: ValveParameters, before_ma: float | None, sent_ma: float, elapsed_s: float) -> float:
    """Return the current that has arrived behind the lags of converter and chamber, taken as one."""
    if before_ma is None:
        before_ma = sent_ma
    fills = sent_ma > before_ma  # pragma: no mutate - where both are the same, no lag matters
    return sent_ma + left_of_lag(elapsed_s, valve.actuator.lag_s(fills=fills)) * (before_ma - sent_ma)
