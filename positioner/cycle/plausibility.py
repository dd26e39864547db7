"""Whether a position reading can be true: its quality, its range, its step, and whether it is frozen. Pure.

A reading that cannot be true is no feedback: the guard then ages what it has, holds, and fails safe.

Frozen is what stays the same to the bit while the command says that the stem must move: by the controller's own model
the current is beyond the stick band, by `frozen_command_ma` and for `frozen_s` in all; pushes add up as long as not a
bit changes. A clean sensor of a stem that sticks inside its band is not frozen however long its reading stays; one that
has shown noise is, whatever the current (see `frozen`). Against a stop, where a transmitter may saturate, none is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from positioner.cycle.frozen import Noise
from positioner.wire.messages import Counted, Quality

if TYPE_CHECKING:
    from positioner.guard.settings import GuardSettings
    from positioner.valve.parameters import ValveParameters
    from positioner.wire.messages import StemPosition

JUMPS_BELIEVED = 3
"""As many jumps in a row to the same place are a new truth: the stem was moved while nobody watched."""
STOP_BAND_OF_SPAN = 0.02
"""How near to a stop, as a part of the span, a reading may stay the same whatever the current."""


@dataclass(frozen=True, slots=True)
class ReadingHistory:
    """What is remembered of the readings.

    position_m: the last plausible one; jumped_m: the last that was refused as a jump, `jumps` in a row.
    rigid_s: for how long, all pushes together, the reading has not moved a bit while the command demanded it.
    noise: what the sensor has shown of its noise.
    """

    position_m: float | None = None
    jumps: int = 0
    jumped_m: float | None = None
    rigid_s: float = 0.0
    noise: Noise = field(default_factory=Noise)


@dataclass(frozen=True, slots=True)
class Refusal:
    """Why a reading cannot be true: what it counts as, and in words."""

    counted: Counted
    why: str


def check_reading(
    settings: GuardSettings,
    valve: ValveParameters,
    watched: ReadingHistory,
    message: StemPosition,
    commanded_ma: float | None,
    elapsed_s: float,
    period_s: float = 0.0,
) -> tuple[ReadingHistory, Refusal | None]:
    """Return what to remember, and the doubt about the reading in `message` if there is one.

    commanded_ma is the current that a law or a person gave, None in other modes; `elapsed_s` lies behind the reading
    before; readings come every `period_s`.
    """
    position, margin = message.position_m, settings.position_margin_m
    if message.quality is Quality.FAULT:
        return watched, Refusal(Counted.FEEDBACK_FAULT, "the sensor reports a fault")
    low, high = valve.travel_min_m - margin, valve.travel_max_m + margin
    if not low <= position <= high:
        told = f"outside the travel ({low * 1e3:g} to {high * 1e3:g} mm with its margin)"
        return watched, Refusal(Counted.FEEDBACK_RANGE, told)
    if watched.position_m is not None and abs(position - watched.position_m) > settings.max_jump_m:
        jumps = watched.jumps + 1 if _is_near(position, watched.jumped_m, settings.max_jump_m) else 1
        if jumps < JUMPS_BELIEVED:
            told = f"a jump of {abs(position - watched.position_m) * 1e3:.1f} mm"
            return replace(watched, jumps=jumps, jumped_m=position), Refusal(Counted.FEEDBACK_JUMP, told)
    acting_ma = None if message.quality is Quality.FAIL_POSITION else commanded_ma
    at_stop = _is_at_stop(valve, position)
    beyond_ma = _beyond_stick_band_ma(valve, position, acting_ma)
    noise = watched.noise.add(position, period_s, elapsed_s, at_rest=beyond_ma <= 0.0, judged=not at_stop)
    pushed = beyond_ma > settings.frozen_command_ma and not at_stop
    rigid_s = _rigid_s(settings, watched, position, acting_ma, elapsed_s * pushed)
    watched = ReadingHistory(position, 0, None, rigid_s, noise)
    if rigid_s > settings.frozen_s:
        told = f"frozen: not a bit of change for {rigid_s:.3g} s under {acting_ma:.3f} mA, which must move the stem"
        return watched, Refusal(Counted.FEEDBACK_FROZEN, told)
    if settings.frozen_s > 0.0 and noise.is_silent(period_s):
        told = f"frozen: not a bit of change for {noise.repeat_s:.3g} s, and its noise never paused so long"
        return watched, Refusal(Counted.FEEDBACK_FROZEN, told)
    return watched, None


def _is_near(position_m: float, other_m: float | None, distance_m: float) -> bool:
    return other_m is not None and abs(position_m - other_m) <= distance_m


def _rigid_s(
    settings: GuardSettings, watched: ReadingHistory, position_m: float, commanded_ma: float | None, pushed_s: float
) -> float:
    """Return for how long the reading has stayed the same to the bit although the command must move the stem."""
    if settings.frozen_s == 0.0 or commanded_ma is None or position_m != watched.position_m:
        return 0.0
    if watched.rigid_s > settings.frozen_s:
        return watched.rigid_s  # only a reading that moves takes the verdict back
    return watched.rigid_s + pushed_s


def _is_at_stop(valve: ValveParameters, position_m: float) -> bool:
    """Return whether a reading is so near to a stop that it may stay the same whatever the current."""
    band_m = STOP_BAND_OF_SPAN * valve.span_m
    return not valve.travel_min_m + band_m < position_m < valve.travel_max_m - band_m


def _beyond_stick_band_ma(valve: ValveParameters, position_m: float, commanded_ma: float | None) -> float:
    """Return by how much the command exceeds what the believed friction holds, in mA; less than 0 where it does not."""
    if commanded_ma is None:
        return -math.inf
    stick_band_ma = valve.static_friction_n / valve.force_gain_n_per_ma
    return abs(commanded_ma - valve.balance_current_ma(position_m)) - stick_band_ma
