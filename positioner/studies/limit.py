"""The time-optimal limit: the shortest time in which the stem can come to rest at a setpoint. Pure.

Full current towards the setpoint, then full current away from it; the instant of the change is found by
bisection on the emulated plant itself, so that the stem comes to rest at the setpoint. No law can be faster.

One change suffices with a lag, too: where the stem stops, the pressure must let it stick. Without lag it can be changed
at once; on the nominal valve with a lag of 2 ms or more the full braking current leaves it inside the stick band.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from plant_emulator import valve
from positioner.bench.playable import LOOP_HIGH_MA, LOOP_LOW_MA

if TYPE_CHECKING:
    from plant_emulator.parameters import PlantSettings
    from plant_emulator.valve import PlantState

_STEP_S = 5e-5
_LONGEST_S = 2.0
_BISECTIONS = 30


@dataclass(frozen=True, slots=True)
class OptimalMove:
    """A time-optimal move: time in s until the stem stays in the 1 % band, and until it rests."""

    settle_1pct_s: float
    rest_s: float


def optimal_move(settings: PlantSettings, start_m: float, setpoint_m: float) -> OptimalMove:
    """Return the time-optimal move from rest at `start_m`, in the middle of the stick band, to rest at `setpoint_m`."""
    opening = setpoint_m > start_m
    push, brake = (LOOP_HIGH_MA, LOOP_LOW_MA) if opening else (LOOP_LOW_MA, LOOP_HIGH_MA)
    sign = 1.0 if opening else -1.0
    state = _at_rest(settings, start_m)
    low, high = 0.0, _LONGEST_S / 4.0
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        if sign * (_played(settings, state, push, brake, middle, sign)[-1][1] - setpoint_m) > 0.0:
            high = middle
        else:
            low = middle
    path = _played(settings, state, push, brake, low, sign)
    band_m = 0.01 * settings.valve.span_m
    outside = [time_s for time_s, position_m in path if abs(position_m - setpoint_m) > band_m]
    return OptimalMove(outside[-1] if outside else 0.0, path[-1][0])


def _at_rest(settings: PlantSettings, position_m: float) -> PlantState:
    return valve.initial_state(replace(settings, valve=replace(settings.valve, initial_position_m=position_m)), 1)


def _played(
    settings: PlantSettings, state: PlantState, push_ma: float, brake_ma: float, switch_s: float, sign: float
) -> list[tuple[float, float]]:
    """Return time and position along a move that pushes until `switch_s` and brakes until the stem turns or rests."""
    path = [(0.0, state.stem.position_m)]
    time_s = 0.0
    while time_s < _LONGEST_S:
        pushing = time_s < switch_s - 1e-12
        step_s = min(_STEP_S, switch_s - time_s) if pushing else _STEP_S
        after = valve.step(settings, state, push_ma if pushing else brake_ma, step_s)
        turned = sign * after.stem.velocity_m_per_s <= 0.0 and sign * (after.stem.position_m - path[0][1]) > 0.0
        if not pushing and (turned or after.stem.position_m == state.stem.position_m):
            # the stem came to rest, or turned, within this step: it is taken to rest at the farther end of the step
            return [*path, (time_s + step_s, max(after.stem.position_m, state.stem.position_m, key=lambda x: sign * x))]
        time_s, state = time_s + step_s, after
        path.append((time_s, after.stem.position_m))
    return path
