"""The stem of a plant with its own physics: what its positions and velocities say of its motion. Pure."""

from __future__ import annotations

from plant_emulator.stem import Stem


def following(stem: Stem, position_m: float, velocity_m_per_s: float, stick_velocity_m_per_s: float) -> Stem:
    """Return the stem one step after `stem`, with its slips, stops, reversals and travel counted.

    It moves where its speed is above the stick velocity. What happens between two steps is not seen: a stem that stops
    and starts again within one has not stopped.
    """
    direction = 0
    if abs(velocity_m_per_s) > stick_velocity_m_per_s:
        direction = 1 if velocity_m_per_s > 0.0 else -1
    begins = direction not in (0, stem.direction)
    return Stem(
        position_m=position_m,
        velocity_m_per_s=velocity_m_per_s,
        direction=direction,
        last_direction=direction or stem.last_direction,
        slips=stem.slips + (begins and stem.direction == 0),
        stops=stem.stops + (direction == 0 and stem.direction != 0),
        reversals=stem.reversals + (begins and stem.last_direction == -direction),
        travel_m=stem.travel_m + abs(position_m - stem.position_m),
    )
