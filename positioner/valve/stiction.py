"""The stiction table: what the valve learned from sticks and slips, by position and direction (paper §5.1, Table 2).

Pure and immutable: `record` returns a new table. A cell keeps the last ten samples of one quantity (D9: ten, as the
paper's text says, not the three of its Table 2), the number of all its samples, and the time of the newest one. Time is
counted in learned samples instead of seconds, so that an age survives a restart and a replay.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from enum import StrEnum
from types import MappingProxyType
from typing import TYPE_CHECKING

from positioner.inputs.table import SettingsTable
from positioner.valve.fit import ValveFit  # noqa: TC001 - pydantic reads it

if TYPE_CHECKING:
    from collections.abc import Iterator

SAMPLES_KEPT = 10
"""Samples a cell keeps (paper §1: "the last ten (10) values")."""
MOST_CELLS = 4096
"""Cells a table holds: three quantities in both directions over 3.4 m of travel in cells of 5 mm."""
FARTHEST_M = 10.0
"""The largest distance of a stem from position 0 in m."""


class Quantity(StrEnum):
    """The quantity of a cell; the value is the name in files and dumps, its suffix the unit."""

    STICK_SPEED = "stick_speed_m_per_s"
    """Speed just before a stop, v_Ag when averaged; never negative."""
    BREAKAWAY_CURRENT = "breakaway_current_ma"
    """Current at the instant of a slip, Γ when averaged."""
    LANDING_BIAS = "landing_bias_m"
    """The place where a move stopped, minus the planned one, or minus that of the configured valve (`nmpc`)."""

    @property
    def limits(self) -> tuple[float, float]:
        """The lowest and the highest sample that any valve could teach, in the quantity's unit."""
        return _LIMITS[self]


_LIMITS = {
    Quantity.STICK_SPEED: (0.0, 100.0),
    Quantity.BREAKAWAY_CURRENT: (-100.0, 100.0),
    Quantity.LANDING_BIAS: (-0.1, 0.1),
}
"""For any valve; the credible range of one valve is much smaller."""


class Direction(StrEnum):
    """Direction of the move that stopped or started."""

    OPENING = "opening"
    CLOSING = "closing"

    @property
    def sign(self) -> float:
        """+1.0 while the position grows, -1.0 while it shrinks."""
        return 1.0 if self is Direction.OPENING else -1.0


def direction_of(value: float) -> Direction:
    """Return the direction of a positive (opening) or negative (closing) speed or error."""
    return Direction.OPENING if value >= 0.0 else Direction.CLOSING


@dataclass(frozen=True, slots=True, order=True)
class CellKey:
    """Address of a cell: the quantity, the position bin (its centre is index * cell_width_m), the direction."""

    quantity: Quantity
    index: int
    direction: Direction


@dataclass(frozen=True, slots=True)
class LearnedSample(SettingsTable):
    """One lesson from a stop or a slip: the quantity, its value in its unit, the position and the direction.

    fit: what the law knows of the whole valve with it, None where it keeps nothing but the table.
    """

    quantity: Quantity
    position_m: float
    direction: Direction
    value: float
    fit: ValveFit | None = None


@dataclass(frozen=True, slots=True)
class Cell:
    """Samples of one quantity at one place: the newest last, at most `SAMPLES_KEPT`.

    `count` is how many were ever recorded; `sequence` is the table's sequence number at the newest one.
    """

    samples: tuple[float, ...]
    count: int
    sequence: int

    @property
    def mean(self) -> float:
        """Mean of the kept samples, in the quantity's unit (v_Ag or Γ of the paper)."""
        total = 0.0
        for sample in self.samples:  # `statistics` computes with fractions, which takes as long as a whole plan
            total += sample
        return total / len(self.samples)

    @property
    def spread(self) -> float:
        """Standard deviation of the kept samples, in the quantity's unit; 0 for a single one."""
        mean, squares = self.mean, 0.0
        for sample in self.samples:
            squares += (sample - mean) * (sample - mean)
        return math.sqrt(squares / len(self.samples))


@dataclass(frozen=True, slots=True)
class StictionTable:
    """All cells of one valve, and the newest fit; `sequence` counts every sample ever recorded."""

    cell_width_m: float = 0.005
    sequence: int = 0
    cells: MappingProxyType[CellKey, Cell] = field(default_factory=lambda: MappingProxyType({}))
    fit: ValveFit | None = None

    def index_of(self, position_m: float) -> int:
        """Return the bin whose centre is nearest to `position_m`."""
        return math.floor(position_m / self.cell_width_m + 0.5)

    def record(
        self, quantity: Quantity, position_m: float, direction: Direction, value: float, fit: ValveFit | None = None
    ) -> StictionTable:
        """Return the table with one more sample; the same table for an impossible value or for a cell too many."""
        low, high = quantity.limits
        if not (low <= value <= high and abs(position_m) <= FARTHEST_M):
            return self
        key = CellKey(quantity, self.index_of(position_m), direction)
        if len(self.cells) >= MOST_CELLS and key not in self.cells:
            return self
        sequence = self.sequence + 1
        old = self.cells.get(key)
        samples = (*(old.samples if old else ()), value)[-SAMPLES_KEPT:]
        cell = Cell(samples, (old.count if old else 0) + 1, sequence)
        return replace(self, sequence=sequence, cells=MappingProxyType(self.cells | {key: cell}), fit=fit or self.fit)

    def learned(self, sample: LearnedSample) -> StictionTable:
        """Return the table with this sample, as `record` does."""
        return self.record(sample.quantity, sample.position_m, sample.direction, sample.value, sample.fit)

    def cell(self, quantity: Quantity, position_m: float, direction: Direction) -> Cell | None:
        """Return the cell that covers `position_m`, or None where nothing was learned."""
        return self.cells.get(CellKey(quantity, self.index_of(position_m), direction))

    def age(self, cell: Cell) -> int:
        """Return how many samples the table has recorded since the newest of `cell`."""
        return self.sequence - cell.sequence

    def __iter__(self) -> Iterator[tuple[CellKey, Cell]]:
        """Yield the cells, sorted by quantity, position and direction."""
        return iter(sorted(self.cells.items()))

    def __len__(self) -> int:
        """Return the number of cells."""
        return len(self.cells)
