"""Cycles before the first one: what Python and the solver do at their first use is done before a valve waits. Shell.

The first cycle of a process takes several periods at 1 kHz: libraries load code, memory is touched for the first time,
the interpreter adapts itself. After some cycles with made-up frames, of a positioner that is connected to nothing, the
first real one is as fast as the others.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from positioner.cycle.input import CycleInput
from positioner.cycle.state import CycleState
from positioner.cycle.step import step
from positioner.valve.stiction import StictionTable
from positioner.wire.messages import Quality, Setpoint, StemPosition

if TYPE_CHECKING:
    from positioner.config.schema import Configuration

_CYCLES = 60
_MOVE_OF_SPAN = 0.1
_NS = 1_000_000_000


def warm_up(configuration: Configuration) -> None:
    """Run some cycles of a valve like this one, with a law and a solver of their own, and forget them."""
    setup = configuration.make_setup(plays=True)
    setup = replace(setup, guard=replace(configuration.guard, auto_arm=True))
    codec, valve = setup.codec, setup.valve
    state = CycleState(table=StictionTable(cell_width_m=configuration.control.table_cell_m))
    middle_m = (valve.travel_min_m + valve.travel_max_m) / 2.0
    step_m = _MOVE_OF_SPAN * (valve.travel_max_m - valve.travel_min_m)
    for cycle in range(_CYCLES):
        # the stem goes to and fro by a little, as a sensor's noise does, and the setpoint asks for a move at half time
        frames = [codec.encode(StemPosition(middle_m + step_m * 1e-3 * (cycle % 3), None, Quality.VALID), cycle)]
        asked_m = middle_m if 2 * cycle < _CYCLES else middle_m + step_m
        frames.insert(0, codec.encode(Setpoint(asked_m), cycle))
        now_ns = round((cycle + 1) * setup.period_s * _NS)
        state, _, _ = step(setup, state, CycleInput(tuple(frames), now_ns))
