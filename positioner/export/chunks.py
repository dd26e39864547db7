"""The rows of an export as arrays, so many rows at a time that the memory is bounded. Pure."""

from __future__ import annotations

from itertools import islice
from typing import TYPE_CHECKING

import numpy as np

from positioner.values import dataclass

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from numpy.typing import NDArray

    from positioner.export.log_rows import Group
    from positioner.export.signals import Signal, Value

_MOST_CELLS = 1 << 22
_FEWEST_ROWS, _MOST_ROWS = 1 << 10, 1 << 16
_LARGEST_SIGNED = 2**63 - 1


@dataclass(frozen=True, slots=True, eq=False)
class Chunk:
    """Some rows: their instants in s, and for each group the places of its rows and their values."""

    time_s: NDArray[np.float64]
    places: tuple[NDArray[np.intp], ...]
    values: tuple[list[list[Value]], ...]

    def column(self, group: int, index: int, signal: Signal) -> tuple[NDArray[np.generic], NDArray[np.bool_] | None]:
        """Return the values of a signal of that group, and which rows hold it: None for all."""
        values = [row[index] for row in self.values[group]]
        if signal.selector is None:
            return np.array(values, kind_of(signal)), None
        held = np.array([value is not None for value in values], np.bool_)
        return np.array([0 if value is None else value for value in values], kind_of(signal)), held


def chunks(groups: Sequence[Group], rows: Iterable[tuple[float, int, list[Value]]]) -> Iterator[Chunk]:
    """Yield all rows in chunks."""
    cells = sum(len(group.signals) for group in groups)
    size = min(max(_MOST_CELLS // max(cells, 1), _FEWEST_ROWS), _MOST_ROWS)
    remaining = iter(rows)
    while some := list(islice(remaining, size)):
        places: tuple[list[int], ...] = tuple([] for _ in groups)
        values: tuple[list[list[Value]], ...] = tuple([] for _ in groups)
        for place, (_, group, row) in enumerate(some):
            places[group].append(place)
            values[group].append(row)
        arrays = tuple(np.array(each, np.intp) for each in places)
        yield Chunk(np.array([time_s for time_s, _, _ in some]), arrays, values)


def kind_of(signal: Signal) -> type[np.float64 | np.int64 | np.uint64]:
    """Return the type of the values of a signal."""
    if not signal.is_whole:
        return np.float64
    return np.uint64 if signal.place.mask > _LARGEST_SIGNED and not signal.place.sign else np.int64
