"""Damages the table file in every byte and at every length: each damage is detected, mended or harmless."""

from __future__ import annotations

import multiprocessing
import random
import shutil
import tempfile
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from tqdm import tqdm

from positioner.store import database
from positioner.store.content import StoredTable
from positioner.store.table_directory import GOOD_COPY, TABLE, TableDirectory
from positioner.valve.stiction import Direction, LearnedSample, Quantity, StictionTable

if TYPE_CHECKING:
    from collections.abc import Iterator

Damage: TypeAlias = tuple[int, int]
"""A place and the bits to flip there, or a length and 0 for a file that ends there."""

VALVE, WIDTH_M = "FV-301", 0.005
_FLIPS = (0x01, 0x10, 0x80, 0xFF)
_LOW_M, _HIGH_M = 0.055, 0.095
_LEARNED, _COPIED = 500, 300
_NOW_S = 1_778_312_125


@dataclass(slots=True)
class Survey:
    """The outcomes of the damaged files: detected and mended, or harmless."""

    size: int
    detected: int = 0
    harmless: int = 0
    violations: list[str] = field(default_factory=list)

    @property
    def summary(self) -> str:
        """One line for the report."""
        return (
            f"{self.detected + self.harmless + len(self.violations)} damaged files of a table of {self.size} bytes: "
            f"{self.detected} detected, set aside and mended from the good copy, {self.harmless} harmless"
        )


@cache
def tables() -> tuple[StoredTable, StoredTable]:
    """Return a realistic table, with samples in every cell of the used travel, and its older good copy."""
    chance = random.Random(7)  # noqa: S311 - the same table each time
    stored = StoredTable(VALVE, StictionTable(cell_width_m=WIDTH_M))
    copied = stored
    for number in range(_LEARNED):
        quantity, direction = chance.choice(tuple(Quantity)), chance.choice(tuple(Direction))
        sample = LearnedSample(quantity, chance.uniform(_LOW_M, _HIGH_M), direction, chance.uniform(*quantity.limits))
        stored = stored.learned(sample, _NOW_S + number)
        copied = stored if number < _COPIED else copied
    return stored, copied


def damages(size: int) -> list[Damage]:
    """Return every single-byte damage and every truncation of a file of `size` bytes."""
    flips = [(place, bits) for place in range(size) for bits in _FLIPS]
    return [*flips, *((length, 0) for length in range(size))]


def everywhere(share: float, seed: int, workers: int) -> Survey:
    """Return what became of the given share of all damages; the files are in memory, because no disk is tested here."""
    memory = Path("/dev/shm")  # noqa: S108 - the name below is unguessable
    with tempfile.TemporaryDirectory(prefix="damage-", dir=memory if memory.is_dir() else None) as name:
        folder = Path(name)
        whole = write_tables(folder / "whole")
        every = damages(len(whole))
        chosen = random.Random(seed).sample(every, round(share * len(every)))  # noqa: S311 - no secret
        survey = Survey(len(whole))
        with multiprocessing.get_context("fork").Pool(workers) as pool:
            found = pool.imap_unordered(partial(what_becomes_of, folder), chosen, chunksize=16)
            for verdict in tqdm(found, total=len(chosen), desc="damaged files", unit=" files", disable=None):
                survey.detected += verdict == "detected"
                survey.harmless += verdict == "harmless"
                survey.violations += [verdict] * (verdict not in {"detected", "harmless"})
    return survey


def write_tables(folder: Path) -> bytes:
    """Write the table and its good copy into a new folder, and return the table's bytes."""
    stored, copied = tables()
    folder.mkdir()
    database.create(folder / TABLE, stored)
    database.create(folder / GOOD_COPY, copied)
    return (folder / TABLE).read_bytes()


def what_becomes_of(folder: Path, damage: Damage) -> str:
    """Return "detected", "harmless" or the error in words, after one start and one save on a damaged table."""
    place, bits = damage
    name = f"byte {place} ^ {bits:#04x}" if bits else f"cut at {place}"
    state = folder / f"{place}-{bits}"
    shutil.copytree(folder / "whole", state)
    whole = (state / TABLE).read_bytes()
    damaged = whole[:place] + bytes([whole[place] ^ bits]) + whole[place + 1 :] if bits else whole[:place]
    (state / TABLE).write_bytes(damaged)
    try:
        return next(_wrong(state, damaged), None) or _kind(state)
    except Exception as error:  # noqa: BLE001 - whatever escapes is the finding
        return f"{name}: {type(error).__name__}: {error}"
    finally:
        shutil.rmtree(state)


def _kind(state: Path) -> str:
    return "detected" if _asides(state) else "harmless"


def _asides(state: Path) -> list[Path]:
    return sorted(state.glob("stiction.damaged-*")) + sorted(state.glob("stiction.foreign-*"))


def _wrong(state: Path, damaged: bytes) -> Iterator[str]:
    """Yield the errors of a start and a save on the damaged table, in words."""
    stored, copied = tables()
    table_directory = TableDirectory(state, VALVE, WIDTH_M)
    found = table_directory.load()
    notices = table_directory.take_notices()
    if found not in (stored, copied):
        yield f"{state.name}: loaded as something else"
    if (found == copied) is not any("using the last good copy" in line and TABLE in line for line in notices):
        yield f"{state.name}: {found.table.sequence} samples loaded, with the notices {notices}"
    more = found.learned(LearnedSample(Quantity.BREAKAWAY_CURRENT, 0.0123, Direction.OPENING, 9.9), _NOW_S)
    table_directory.save(more)
    table_directory.close()
    if database.read(state / TABLE) != more:
        yield f"{state.name}: what was saved next is not on the disk"
    asides = _asides(state)
    if found == copied and [path.read_bytes() for path in asides] != [damaged]:
        yield f"{state.name}: the damaged table was not set aside as it was: {asides}"
    if found == copied and not any(str(asides[0]) in line for line in table_directory.take_notices()):
        yield f"{state.name}: the place of the damaged table was not named"
