"""What a new setpoint changes: for a stem at rest, on a ramp, and sliding. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.laws.nmpc.lagged.memory import Ramp
from positioner.laws.nmpc.lagged.rest import LaggedRest
from positioner.values import replace

if TYPE_CHECKING:
    from positioner.laws.nmpc.lagged.memory import LaggedMemory


def with_setpoint(memory: LaggedMemory, setpoint_m: float, tolerance_m: float, span_m: float) -> LaggedMemory:
    """Return the memory with this setpoint; a ramp that would now begin the wrong move is given up."""
    before_m = memory.setpoint_m
    if setpoint_m == before_m:
        return memory
    is_other = before_m is None or abs(setpoint_m - memory.anchor_m) > tolerance_m
    memory = replace(
        memory,
        setpoint_m=setpoint_m,
        anchor_m=setpoint_m if is_other else memory.anchor_m,
        is_new=memory.is_new or is_other,
        corrections=0 if is_other else memory.corrections,
        pushes=memory.pushes.for_setpoint(setpoint_m, span_m),
    )
    stem = memory.stem
    if isinstance(stem, LaggedRest) or not is_other:
        return memory
    move, s = stem.move, stem.move.direction
    here_m = stem.rest.x if isinstance(stem, Ramp) else stem.state.x
    if move.is_final and s * (setpoint_m - move.target_m) > 0.0:
        # farther in the same direction: the same move ends there
        move = replace(move, target_m=setpoint_m, aim_m=setpoint_m + (move.aim_m - move.target_m))
        return replace(memory, stem=replace(stem, move=move), is_new=False)
    if isinstance(stem, Ramp) and s * (setpoint_m - here_m) < s * (move.target_m - move.origin_m):
        return replace(memory, stem=replace(stem.rest, settle_s=0.0), is_final=True)
    return memory
