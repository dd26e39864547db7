"""The input of a cycle: the frames, the instant, and what else the shell reports. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.values import dataclass

if TYPE_CHECKING:
    from positioner.valve.stiction import StictionTable
    from positioner.wire.messages import CanFrame


@dataclass(frozen=True, slots=True)
class CycleInput:
    """All that one cycle is given from outside; the record holds it, and replay reads it there.

    frames: received since the last cycle, oldest first; now_ns: the monotonic instant.
    late_ns: for how long the bus was not read before, 0 where that was no longer than a period.
    lines_dropped: lines of the log that were dropped since the last cycle.
    table_saved: whether all learned samples are on the disk; table: another stiction table in place of the present one.
    unsent: the last command could not be sent.
    alarms: of the valve's condition, as `positioner.cycle.alarms` packs them; 0 while there was none.
    """

    frames: tuple[CanFrame, ...]
    now_ns: int
    late_ns: int = 0
    lines_dropped: int = 0
    table_saved: bool = True
    unsent: bool = False
    table: StictionTable | None = None
    alarms: int = 0
