"""What a record says about its valve: by the stem position where it is there, else by OP and PV alone. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from positioner.diagnostics.direct.diagnosis import DirectDiagnosis, Record, diagnose_stem
from positioner.diagnostics.indirect.diagnosis import LEAST_SAMPLES, Diagnosis, diagnose_loop
from positioner.diagnostics.indirect.loop import Loop, range_of
from positioner.diagnostics.verdict import Estimate, Verdict
from positioner.errors import RecordError

if TYPE_CHECKING:
    from positioner.diagnostics.loop_table import LoopTable

Array = NDArray[np.float64]

_LEAST_STEM_SAMPLES = 30
_ONLY_BY_PV = (Verdict.UNDECIDED, Verdict.YES)
_LOWEST_PERCENT, _NARROWEST_PERCENT, _HIGHEST_PERCENT = -20.0, 5.0, 120.0


@dataclass(frozen=True, slots=True)
class Finding:
    """Both diagnoses, each None where the record has not what it needs, and the notes about the record.

    The direct one decides, unless it is undecided and the other says yes: where the stem itself shows too little, PV,
    which knows less of it, cannot say no. moved_percent: how far OP went.
    """

    source: str
    direct: DirectDiagnosis | None
    indirect: Diagnosis | None
    samples: int
    period_s: float
    is_timed: bool
    notes: tuple[str, ...]
    moved_percent: float

    @property
    def verdict(self) -> Verdict:
        """Whether the valve sticks."""
        return self._deciding.verdict

    @property
    def reason(self) -> str:
        """The reason of the verdict."""
        return self._deciding.reason

    @property
    def is_direct(self) -> bool:
        """Whether the stem position has decided."""
        return self._deciding is self.direct

    @property
    def stick(self) -> Estimate | None:
        """S in percent of the command, where the valve sticks."""
        if self.is_direct and self.direct is not None:
            friction = self.direct.friction
            return friction.stick if friction and self.verdict is Verdict.YES else None
        return self.indirect.stick if self.indirect else None

    @property
    def jump(self) -> Estimate | None:
        """J in percent of the command, where the stem position shows it."""
        friction = self.direct.friction if self.direct else None
        return friction.jump if friction and self.is_direct and self.verdict is Verdict.YES else None

    @property
    def _deciding(self) -> DirectDiagnosis | Diagnosis:
        first, second = self.direct, self.indirect
        if second is not None and (first is None or (first.verdict, second.verdict) == _ONLY_BY_PV):
            return second
        if first is not None:
            return first
        raise RecordError(f"{self.source}: holds neither a stem position nor a process value")


def percent(op: Array, low: float, high: float) -> Array:
    """Return OP in percent of its span from `low` to `high`."""
    return np.asarray(100.0 * (op - low) / (high - low))


def finding_of(source: str, table: LoopTable, command_low: float, command_high: float) -> Finding:
    """Return the finding of a table; command_low and command_high are 0 and 100 % of OP.

    Raises:
        RecordError: there are too few samples.
    """
    op = percent(table.op, command_low, command_high)
    if op.size < _LEAST_STEM_SAMPLES or (table.stem is None and op.size < LEAST_SAMPLES):
        least = LEAST_SAMPLES if table.stem is None else _LEAST_STEM_SAMPLES
        raise RecordError(f"{source}: holds {op.size} samples without a gap, and at least {least} are needed")
    direct = indirect = None
    if table.stem is not None:
        direct = diagnose_stem(_record(op, table))
    if table.pv is not None and op.size >= LEAST_SAMPLES:
        sp = table.sp if table.sp is not None else np.zeros(0)
        indirect = diagnose_loop(Loop(op, table.pv, sp, table.period_s))
    notes = (*table.notes, *_of_range(table.op, op))
    return Finding(source, direct, indirect, int(op.size), table.period_s, table.is_timed, notes, range_of(op))


def _of_range(given: Array, op: Array) -> tuple[str, ...]:
    """Return a note where OP is probably not in the unit of its range."""
    lowest, highest = float(np.min(given)), float(np.max(given))
    if float(np.max(op)) > _HIGHEST_PERCENT or float(np.min(op)) < _LOWEST_PERCENT or float(np.max(op)) <= 1.0:
        text = f"OP goes from {lowest:.4g} to {highest:.4g}: give --op-range, if these are no percent"
        return (f"{text}; S, J and their limits are in percent of that range",)
    return ()


def _record(op: Array, table: LoopTable) -> Record:
    """Return the record of the stem; a position in no percent tells its slope by its spread."""
    stem = table.stem if table.stem is not None else np.zeros(0)
    if table.slope is not None:
        return Record(op, stem, table.period_s, table.slope, table.slope_sigma, 0)
    lowest, highest = float(np.min(stem)), float(np.max(stem))
    if lowest >= _LOWEST_PERCENT and _NARROWEST_PERCENT < highest <= _HIGHEST_PERCENT:
        return Record(op, stem, table.period_s)
    spread = float(np.std(stem))
    slope = float(np.std(op)) / spread if spread > 0.0 else 1.0
    return Record(op, stem, table.period_s, slope, 0.5 * slope)
