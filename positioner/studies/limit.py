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
from plant_emulator.friction_settings import FrictionSettings
from positioner.bench.playable import LOOP_HIGH_MA, LOOP_LOW_MA

if TYPE_CHECKING:
    from plant_emulator.parameters import PlantSettings
    from plant_emulator.valve import PlantState

_STEP_S = 5e-5
_LONGEST_S = 2.0
_BISECTIONS = 30
_OPENING, _CLOSING = (LOOP_HIGH_MA, LOOP_LOW_MA), (LOOP_LOW_MA, LOOP_HIGH_MA)


@dataclass(frozen=True, slots=True)
class OptimalMove:
    """A time-optimal move: time in s until the stem stays in the 1 % band, and until it rests."""

    settle_1pct_s: float
    rest_s: float


def optimal_move(
    settings: PlantSettings,
    start_m: float,
    setpoint_m: float,
    *,
    step_s: float = _STEP_S,
    longest_s: float = _LONGEST_S,
    bisections: int = _BISECTIONS,
) -> OptimalMove:
    """Return the time-optimal move from rest at `start_m`, in the middle of the stick band, to rest at `setpoint_m`.

    A plant with its own physics cannot be put anywhere: then it is that of a valve as its tables say. A stem on an
    elastic contact never rests, so its friction is taken as Karnopp's.

    step_s: resolution of its times. longest_s: no move is taken to last longer. bisections: of the instant of the
    change, from an interval of a quarter of longest_s.
    """
    settings = replace(settings, physics=None, friction=FrictionSettings())
    opening = setpoint_m > start_m
    currents = _OPENING if opening else _CLOSING
    sign = 1.0 if opening else -1.0
    state = _at_rest(settings, start_m)
    low, high = 0.0, longest_s / 4.0
    for _ in range(bisections):
        middle = 0.5 * (low + high)
        if sign * (_played(settings, state, currents, middle, sign, step_s, longest_s)[-1][1] - setpoint_m) > 0.0:
            high = middle
        else:
            low = middle
    path = _played(settings, state, currents, low, sign, step_s, longest_s)
    band_m = 0.01 * settings.valve.span_m
    outside = [time_s for time_s, position_m in path if abs(position_m - setpoint_m) > band_m]
    return OptimalMove(outside[-1] if outside else 0.0, path[-1][0])


def _at_rest(settings: PlantSettings, position_m: float) -> PlantState:
    return valve.initial_state(replace(settings, valve=replace(settings.valve, initial_position_m=position_m)), 1)


def _played(
    settings: PlantSettings,
    state: PlantState,
    currents: tuple[float, float],
    switch_s: float,
    sign: float,
    step_s: float,
    longest_s: float,
) -> list[tuple[float, float]]:
    """Return time and position along a move that pushes until `switch_s` and brakes until the stem turns or rests."""
    path = [(0.0, state.stem.position_m)]
    time_s, (push_ma, brake_ma), longest_step_s = 0.0, currents, step_s
    while time_s < longest_s:
        pushing = time_s < switch_s - 1e-12
        step_s = min(longest_step_s, switch_s - time_s) if pushing else longest_step_s
        after = valve.step(settings, state, push_ma if pushing else brake_ma, step_s)
        turned = sign * after.stem.velocity_m_per_s <= 0.0 and sign * (after.stem.position_m - path[0][1]) > 0.0
        if not pushing and (turned or after.stem.position_m == state.stem.position_m):
            # the stem came to rest, or turned, within this step: it is taken to rest at the farther end of the step
            return [*path, (time_s + step_s, max(after.stem.position_m, state.stem.position_m, key=lambda x: sign * x))]
        time_s, state = time_s + step_s, after
        path.append((time_s, after.stem.position_m))
    return path
