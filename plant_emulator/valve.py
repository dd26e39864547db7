"""One emulated valve: settings, state, current and duration in, next state out. Pure.

The result does not depend on how a duration is cut into steps: between two events the motion is exact, and every event
is located. Plant time is the state's own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from plant_emulator.actuator import AirLine, commanded, pushing_force
from plant_emulator.friction import Packing, initial_packing
from plant_emulator.mechanics import mechanics
from plant_emulator.stem import Stem

if TYPE_CHECKING:
    from plant_emulator.parameters import PlantSettings


@dataclass(frozen=True, slots=True)
class PlantState:
    """A valve at one instant; the counters run from the start of the plant."""

    time_s: float
    position_m: float
    velocity_m_per_s: float
    pressure_pa: float
    friction_n: float
    """Friction on the stem, positive against opening motion; at rest what it holds, at most F_s."""
    direction: int
    """+1 opening, -1 closing, 0 at rest."""
    last_direction: int
    line: AirLine
    packing: Packing
    slips: int = 0
    stops: int = 0
    reversals: int = 0
    travel_m: float = 0.0

    @property
    def stuck(self) -> bool:
        """True at rest: held by static friction, against a travel stop, or in balance without friction."""
        return self.direction == 0


def initial_state(settings: PlantSettings, seed: int) -> PlantState:
    """Return a valve at rest at its initial position, with the pressure that balances its spring there."""
    valve = settings.valve
    push_n = valve.bench_set_n + valve.spring_rate_n_per_m * valve.initial_position_m
    pressure_pa = push_n / valve.diaphragm_area_m2
    return PlantState(
        time_s=0.0,
        position_m=valve.initial_position_m,
        velocity_m_per_s=0.0,
        pressure_pa=pressure_pa,
        friction_n=0.0,
        direction=0,
        last_direction=0,
        line=AirLine(pressure_pa / valve.pressure_gain_pa_per_ma),
        packing=initial_packing(settings, seed),
    )


def held_state(settings: PlantSettings, seed: int, current_ma: float) -> PlantState:
    """Return a valve that is held at its initial position, with the pressure that belongs to `current_ma`."""
    state = initial_state(settings, seed)
    pressure_pa = settings.valve.pressure_gain_pa_per_ma * current_ma
    stem = Stem(mechanics(settings), state.position_m, 0.0, 0, 0, state.packing, 0, 0, 0, 0.0)
    friction_n = stem.friction_n(pressure_pa * settings.valve.diaphragm_area_m2)
    return replace(state, pressure_pa=pressure_pa, friction_n=friction_n, line=AirLine(current_ma))


def step(settings: PlantSettings, state: PlantState, current_ma: float, duration_s: float) -> PlantState:
    """Return the valve `duration_s` later, its loop current held at `current_ma` meanwhile."""
    constants = mechanics(settings)
    valve, actuator = settings.valve, settings.actuator
    line, stretches = commanded(state.line, actuator.dead_time_s, current_ma, state.time_s, duration_s)
    stem = Stem(
        constants,
        state.position_m,
        state.velocity_m_per_s,
        state.direction,
        state.last_direction,
        state.packing,
        state.slips,
        state.stops,
        state.reversals,
        state.travel_m,
    )
    pressure_pa = state.pressure_pa
    for acting_ma, stretch_s in stretches:
        force = pushing_force(actuator, valve.diaphragm_area_m2, pressure_pa, valve.pressure_gain_pa_per_ma * acting_ma)
        stem.advance(force, stretch_s)
        pressure_pa = force.at(stretch_s) / valve.diaphragm_area_m2
    return PlantState(
        state.time_s + duration_s,
        stem.position_m,
        stem.velocity_m_per_s,
        pressure_pa,
        stem.friction_n(pressure_pa * valve.diaphragm_area_m2),
        stem.direction,
        stem.last_direction,
        line,
        stem.packing,
        stem.slips,
        stem.stops,
        stem.reversals,
        stem.travel_m,
    )
