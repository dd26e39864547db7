"""Whether pushes move neither the stem nor its reading: the valve or its sensor is stuck. Pure.

A stem that a push frees moves, and so does its reading. A reading that stays the same to the bit (of a sensor without
noise, or with a coarse step) while the current, behind the configured lags, goes beyond the believed stick band again
and again, is that of a stuck stem or of a frozen sensor; the true stem may be anywhere. Of a noisy sensor the law says
which of its pushes failed, and the mean reading shows that the stem has not moved meanwhile.

A few pushes in vain are ordinary: a law raises its belief of the friction by them. Where the loop current cannot reach
the setpoint, a law may push in vain, too: that has its own cause. `plausibility` refuses a reading that stays the same
while the current is far beyond the stick band for long; short pushes, or small ones, are never that.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.values import dataclass

if TYPE_CHECKING:
    from positioner.valve.parameters import ValveParameters

OFTEN_ENOUGH = 10
"""Pushes without a bit of change. Each raises the friction that `nmpc` believes, and a third more of it is no fault."""
LONG_ENOUGH_S = 5.0
"""The reading has stayed the same, or pushes have failed at one place, for so long meanwhile: a law that knocks frees a
stem sooner, or not at all; one that pushes in every cycle, on readings that a sensor holds, needs some of them."""
FAILED = 20
"""Pushes in a row that a law has found to fail, of a stem whose readings have noise; then a law rests."""
MOVED_OF_SPAN = 0.02
"""A mean reading (over 0.1 s, σ 0.4 % of span at 20 ms and 2 % noise) that has moved so far shows that the stem has."""


@dataclass(frozen=True, slots=True)
class VainPushes:
    """The pushes since the reading last changed.

    is_pushed: whether the current is beyond the stick band now; count: how often it has gone there since.
    failed: pushes in a row that the law has found to fail, less the first `before` of them, which were made elsewhere;
    place_m: the mean reading at the first one; lasted_s: time since then.
    """

    is_pushed: bool = False
    count: int = 0
    failed: int = 0
    before: int = 0
    place_m: float = 0.0
    lasted_s: float = 0.0

    def after_failed(self, valve: ValveParameters, pushes: int, mean_m: float) -> VainPushes:
        """Return the pushes after the law has found that its last `pushes` in a row failed, with this mean reading."""
        before, place_m, lasted_s = self.before, self.place_m, self.lasted_s
        if self.failed == 0 or pushes <= before or abs(mean_m - place_m) > MOVED_OF_SPAN * valve.span_m:
            before, place_m, lasted_s = pushes - 1, mean_m, 0.0
        return VainPushes(self.is_pushed, self.count, pushes - before, before, place_m, lasted_s)


@dataclass(frozen=True, slots=True)
class NoMotion:
    """Pushes move nothing: so many, from this reading."""

    pushes: int
    position_m: float

    def __str__(self) -> str:
        """One line for the log."""
        return (
            f"no motion: {self.pushes} pushes moved neither the stem nor its reading, {self.position_m * 1e3:.1f} mm: "
            "look for a frozen sensor, a stuck stem, missing air, and a stronger spring or friction than configured"
        )


NO_PUSHES = VainPushes()


def track_vain(
    valve: ValveParameters,
    known: VainPushes,
    measured_m: float,
    mean_m: float,
    repeat_s: float,
    arrived_ma: float,
    elapsed_s: float,
) -> VainPushes:
    """Return the pushes after a reading that has been the same for `repeat_s`, with the current at the diaphragm."""
    is_pushed, count = known.is_pushed, known.count
    if repeat_s == 0.0:
        is_pushed, count = False, 0
    else:
        band_ma = valve.static_friction_n / valve.force_gain_n_per_ma
        is_pushed = abs(arrived_ma - valve.balance_current_ma(measured_m)) > band_ma
        count += is_pushed and not known.is_pushed
    if known.failed and abs(mean_m - known.place_m) <= MOVED_OF_SPAN * valve.span_m:
        lasted_s = known.lasted_s + elapsed_s
        return VainPushes(is_pushed, count, known.failed, known.before, known.place_m, lasted_s)
    return VainPushes(is_pushed, count) if is_pushed or count else NO_PUSHES


def are_in_vain(pushes: VainPushes, repeat_s: float) -> bool:
    """Return whether pushes move neither the stem nor its reading, which has been the same for `repeat_s`."""
    has_stood = pushes.count >= OFTEN_ENOUGH and repeat_s >= LONG_ENOUGH_S
    return has_stood or (pushes.failed >= FAILED and pushes.lasted_s >= LONG_ENOUGH_S)
