"""Whether a position reading can be true: its quality, its range, its step, and whether it is frozen. Pure.

A reading that cannot be true is no feedback: the guard ages the last good one, goes to HOLD, and fails safe.

A reading is frozen when it stays the same to the bit although the stem must move: by the controller's own model the
current is beyond the stick band, by `frozen_command_ma` and for `frozen_s` in all. Pushes add up as long as the reading
stays the same. A clean sensor of a stem that sticks inside its band is never frozen; a sensor that has shown noise can
be frozen under any current (see `frozen`). Against a stop, where a transmitter may saturate, none is.
"""

from __future__ import annotations

import math
from dataclasses import field
from typing import TYPE_CHECKING

from positioner.cycle.frozen import Noise
from positioner.values import dataclass, replace
from positioner.wire.messages import Counted, Quality

if TYPE_CHECKING:
    from positioner.guard.settings import GuardSettings
    from positioner.valve.parameters import ValveParameters
    from positioner.wire.messages import StemPosition

JUMPS_BELIEVED = 3
"""After so many jumps in a row to the same place, the place is believed: the stem moved while no reading came."""
STOP_BAND_OF_SPAN = 0.02
"""Within this part of the span from a stop, a reading may stay the same under any current."""


@dataclass(frozen=True, slots=True)
class ReadingHistory:
    """What is remembered of the readings.

    position_m: the last plausible one; jumped_m: the last one that was refused as a jump, `jumps` of them in a row.
    rigid_s: for how long, all pushes together, the reading stayed the same although the stem had to move.
    noise: what noise the sensor has shown.
    """

    position_m: float | None = None
    jumps: int = 0
    jumped_m: float | None = None
    rigid_s: float = 0.0
    noise: Noise = field(default_factory=Noise)


@dataclass(frozen=True, slots=True)
class Refusal:
    """Why a reading cannot be true: the cause under which it is counted, and the reason in words."""

    counted: Counted
    why: str


def check_reading(
    settings: GuardSettings,
    valve: ValveParameters,
    history: ReadingHistory,
    message: StemPosition,
    commanded_ma: float | None,
    elapsed_s: float,
    period_s: float,
) -> tuple[ReadingHistory, Refusal | None]:
    """Return what to remember, and why the reading in `message` is refused, None where it is plausible.

    commanded_ma is the current that a law or a person gave, None in other modes; the reading before came
    `elapsed_s` earlier; readings come every `period_s`.
    """
    position, margin = message.position_m, settings.position_margin_m
    if message.quality is Quality.FAULT:
        return history, Refusal(Counted.FEEDBACK_FAULT, "the sensor reports a fault")
    low, high = valve.travel_min_m - margin, valve.travel_max_m + margin
    if not low <= position <= high:
        why = f"outside the travel ({low * 1e3:g} to {high * 1e3:g} mm with its margin)"
        return history, Refusal(Counted.FEEDBACK_RANGE, why)
    if history.position_m is not None and abs(position - history.position_m) > settings.max_jump_m:
        jumps = history.jumps + 1 if _is_near(position, history.jumped_m, settings.max_jump_m) else 1
        if jumps < JUMPS_BELIEVED:
            why = f"a jump of {abs(position - history.position_m) * 1e3:.1f} mm"
            return replace(history, jumps=jumps, jumped_m=position), Refusal(Counted.FEEDBACK_JUMP, why)
    acting_ma = None if message.quality is Quality.FAIL_POSITION else commanded_ma
    at_stop = _is_at_stop(valve, position)
    beyond_ma = _beyond_stick_band_ma(valve, position, acting_ma)
    noise = history.noise.add(position, period_s, elapsed_s, at_rest=beyond_ma <= 0.0, counts=not at_stop)
    pushed = beyond_ma > settings.frozen_command_ma and not at_stop
    rigid_s = _rigid_s(settings, history, position, acting_ma, elapsed_s * pushed)
    history = ReadingHistory(position_m=position, rigid_s=rigid_s, noise=noise)
    if rigid_s > settings.frozen_s:
        why = f"frozen: not a bit of change for {rigid_s:.3g} s under {acting_ma:.3f} mA, which must move the stem"
        return history, Refusal(Counted.FEEDBACK_FROZEN, why)
    if settings.frozen_s > 0.0 and noise.is_silent(period_s):
        why = f"frozen: not a bit of change for {noise.repeat_s:.3g} s, and its noise never paused so long"
        return history, Refusal(Counted.FEEDBACK_FROZEN, why)
    return history, None


def _is_near(position_m: float, other_m: float | None, distance_m: float) -> bool:
    return other_m is not None and abs(position_m - other_m) <= distance_m


def _rigid_s(
    settings: GuardSettings, history: ReadingHistory, position_m: float, commanded_ma: float | None, pushed_s: float
) -> float:
    """Return for how long the reading has stayed the same to the bit although the stem had to move."""
    if settings.frozen_s == 0.0 or commanded_ma is None or position_m != history.position_m:
        return 0.0
    if history.rigid_s > settings.frozen_s:
        return history.rigid_s  # only a reading that changes ends it
    return history.rigid_s + pushed_s


def _is_at_stop(valve: ValveParameters, position_m: float) -> bool:
    """Return whether a reading is so near to a stop that it may stay the same under any current."""
    band_m = STOP_BAND_OF_SPAN * valve.span_m
    return not valve.travel_min_m + band_m < position_m < valve.travel_max_m - band_m


def _beyond_stick_band_ma(valve: ValveParameters, position_m: float, commanded_ma: float | None) -> float:
    """Return by how much the command exceeds what the believed friction holds, in mA; less than 0 where it does not."""
    if commanded_ma is None:
        return -math.inf
    stick_band_ma = valve.static_friction_n / valve.force_gain_n_per_ma
    return abs(commanded_ma - valve.balance_current_ma(position_m)) - stick_band_ma
