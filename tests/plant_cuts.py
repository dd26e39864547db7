"""A plant that takes each of its commands in one step, and the same one that takes them in many."""

from __future__ import annotations

from typing import TYPE_CHECKING

from plant_emulator import valve

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from plant_emulator.parameters import PlantSettings
    from plant_emulator.valve import PlantState


def whole_and_cut(
    plant: PlantSettings, seed: int, commands: Sequence[tuple[float, float]], pieces: int
) -> Iterator[tuple[PlantState, PlantState]]:
    """Yield both after each command, a current in mA and its duration in s."""
    whole = cut = valve.initial_state(plant, seed)
    for current_ma, duration_s in commands:
        whole = valve.step(plant, whole, current_ma, duration_s)
        for _ in range(pieces):
            cut = valve.step(plant, cut, current_ma, duration_s / pieces)
        yield whole, cut
