"""The table after a kill, as the daemon's own code loads it, compared with the sample log."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from positioner.store.file_check import SIDECARS
from positioner.store.table_directory import TABLE, TableDirectory

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    from endurance.sample_log import Entry
    from positioner.valve.stiction import StictionTable

_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class KillOutcome:
    """One kill of one kind: the samples saved since the last kill, the lost ones, and the violations.

    torn: the kill came during a transaction. start_s: the table writer took this long to start; 0: it was not timed.
    """

    kind: str
    saved: int
    lost: int
    oldest_s: float
    torn: bool
    violations: tuple[str, ...] = ()
    start_s: float = 0.0


@dataclass(slots=True)
class KillCounters:
    """The sum of many kills."""

    kills: dict[str, int] = field(default_factory=dict)
    torn: int = 0
    saved: int = 0
    lost: int = 0
    oldest: dict[str, float] = field(default_factory=dict)
    violations: list[str] = field(default_factory=list)
    start_s: float = 0.0

    def add(self, outcome: KillOutcome) -> None:
        """Add one kill."""
        self.kills[outcome.kind] = self.kills.get(outcome.kind, 0) + 1
        self.torn += outcome.torn
        self.saved += outcome.saved
        self.lost += outcome.lost
        self.oldest[outcome.kind] = max(self.oldest.get(outcome.kind, 0.0), outcome.oldest_s)
        self.violations.extend(outcome.violations)
        self.start_s = max(self.start_s, outcome.start_s)

    @property
    def oldest_s(self) -> float:
        """The age in s of the oldest sample that was lost by any kill."""
        return max(self.oldest.values(), default=0.0)


@dataclass(slots=True)
class TableCheck:
    """Checks one state directory: it must hold the table of the last check, and then samples of the sample log."""

    state: Path
    valve_id: str
    table: StictionTable

    def after_kill(self, kind: str, entries: Sequence[Entry], killed_ns: int) -> KillOutcome:
        """Return the outcome of a kill at `killed_ns`; nobody may write the table meanwhile."""
        torn = any((self.state / f"{TABLE}{suffix}").exists() for suffix in SIDECARS)
        table_directory = TableDirectory(self.state, self.valve_id, self.table.cell_width_m)
        found = table_directory.load().table
        violations = [f"the load reported: {notice}" for notice in table_directory.take_notices()]
        violations += [f"{path.name} was set aside" for path in self.state.glob("stiction.*-*.sqlite*")]
        saved = [entry for entry in entries if self.table.sequence < entry.sequence <= found.sequence]
        lost = [entry for entry in entries if entry.sequence > found.sequence]
        if found.sequence < self.table.sequence:
            violations.append(f"went back from {self.table.sequence} to {found.sequence} samples")
        elif found != taught(self.table, saved):
            violations.append(f"has a hole: not the first {found.sequence} samples, in their order")
        self.table = found
        oldest_s = max(((killed_ns - entry.written_ns) / _NS for entry in lost), default=0.0)
        found_wrong = tuple(f"{self.state}, {kind}: {violation}" for violation in violations)
        return KillOutcome(kind, len(saved), len(lost), oldest_s, torn, found_wrong)


def difference(found: StictionTable, expected: StictionTable) -> str:
    """Return in words how the kept table differs from the expected one; empty where they are equal."""
    if found == expected:
        return ""
    if found.sequence != expected.sequence:
        return f"{found.sequence} samples are kept, not {expected.sequence}"
    cells = dict(found.cells.items() ^ expected.cells.items())
    if cells:
        return f"other samples in {', '.join(sorted(map(str, cells)))}"
    return f"the fit {found.fit} is kept, not {expected.fit}"


def taught(table: StictionTable, entries: Iterable[Entry]) -> StictionTable:
    """Return the table with the samples of the sample log."""
    for entry in entries:
        table = table.learned(entry.sample)
    return table
