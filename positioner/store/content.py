"""The content of the store: the stiction table, its valve, and the times of its samples. Pure."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from types import MappingProxyType

from positioner.valve.stiction import CellKey, LearnedSample, StictionTable


@dataclass(frozen=True, slots=True)
class StoredTable:
    """A stiction table with its identity.

    `generation` counts resets and imports: samples of one generation never enter another. `recorded_s` is the
    wall-clock time (seconds since 1970) of each cell's newest sample, for people only. The fit ages by
    `fit_recorded_s`.
    """

    valve_id: str
    table: StictionTable
    generation: int = 0
    recorded_s: MappingProxyType[CellKey, int] = field(default_factory=lambda: MappingProxyType({}))
    fit_recorded_s: int = 0

    def table_at(self, now_s: int) -> StictionTable:
        """Return the table as it is to be used from `now_s` on: its fit is older than when it was kept."""
        fit = self.table.fit
        if fit is None:
            return self.table
        return replace(self.table, fit=fit.aged(now_s - self.fit_recorded_s))

    def learned(self, sample: LearnedSample, now_s: int) -> StoredTable:
        """Return the table with one more sample, or itself where `StictionTable.record` refuses the sample."""
        table = self.table.learned(sample)
        if table is self.table:
            return self
        key = CellKey(sample.quantity, table.index_of(sample.position_m), sample.direction)
        fit_s = self.fit_recorded_s if sample.fit is None else now_s
        recorded_s = MappingProxyType(self.recorded_s | {key: now_s})
        return replace(self, table=table, recorded_s=recorded_s, fit_recorded_s=fit_s)

    def emptied(self) -> StoredTable:
        """Return the empty table of the next generation."""
        table = StictionTable(cell_width_m=self.table.cell_width_m)
        return StoredTable(self.valve_id, table, self.generation + 1)

    def succeeded_by(self, other: StoredTable) -> StoredTable:
        """Return `other`'s cells as this valve's next generation."""
        return replace(other, valve_id=self.valve_id, generation=self.generation + 1)
