"""The content of the store: the stiction table, its valve, and the times of its samples. Pure."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from types import MappingProxyType

from positioner.valve.stiction import CellKey, LearnedSample, StictionTable


@dataclass(frozen=True, slots=True)
class StoredTable:
    """A stiction table with its identity.

    `generation` counts resets and imports: samples of one generation never enter another. `recorded_s` is the
    wall-clock time (seconds since 1970) of each cell's newest sample, for people only.
    """

    valve_id: str
    table: StictionTable
    generation: int = 0
    recorded_s: MappingProxyType[CellKey, int] = field(default_factory=lambda: MappingProxyType({}))

    def learned(self, sample: LearnedSample, now_s: int) -> StoredTable:
        """Return the table with one more sample, or itself where `StictionTable.record` refuses the sample."""
        table = self.table.record(sample.quantity, sample.position_m, sample.direction, sample.value)
        if table is self.table:
            return self
        key = CellKey(sample.quantity, table.index_of(sample.position_m), sample.direction)
        return replace(self, table=table, recorded_s=MappingProxyType(self.recorded_s | {key: now_s}))

    def emptied(self) -> StoredTable:
        """Return the empty table of the next generation."""
        table = StictionTable(cell_width_m=self.table.cell_width_m)
        return StoredTable(self.valve_id, table, self.generation + 1)

    def succeeded_by(self, other: StoredTable) -> StoredTable:
        """Return `other`'s cells as this valve's next generation."""
        return replace(other, valve_id=self.valve_id, generation=self.generation + 1)
