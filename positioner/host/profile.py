"""A profile: setpoints over time, played once or again and again. Pure."""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass
from typing import TYPE_CHECKING

from positioner.inputs.durations import duration

if TYPE_CHECKING:
    from positioner.inputs.setpoint_file import SetpointRow


@dataclass(frozen=True, slots=True)
class Profile:
    """The rows of a file, played `repeats` times, 0 for ever; the last one holds as long as the one before it."""

    name: str
    rows: tuple[SetpointRow, ...]
    repeats: int = 1

    @property
    def round_s(self) -> float:
        """How long one round lasts, in s."""
        return 2.0 * self.rows[-1].time_s - self.rows[-2].time_s - self.rows[0].time_s

    @property
    def duration_s(self) -> float:
        """How long all rounds last, in s."""
        return self.repeats * self.round_s if self.repeats else math.inf

    def row_at(self, elapsed_s: float) -> SetpointRow:
        """Return the row that holds `elapsed_s` after the begin."""
        time_s = self.rows[0].time_s + elapsed_s % self.round_s
        return self.rows[max(bisect_right(self.rows, time_s, key=lambda row: row.time_s) - 1, 0)]

    def progress(self, elapsed_s: float) -> str:
        """Return how far it is, in a few words."""
        done_s = min(elapsed_s, self.duration_s)
        if not self.repeats:
            return f"{self.name}: {done_s:.1f} s, round {int(done_s / self.round_s) + 1}"
        turn = min(int(done_s / self.round_s), self.repeats - 1) + 1
        rounds = f", round {turn} of {self.repeats}" if self.repeats > 1 else ""
        return f"{self.name}: {done_s:.1f} of {duration(self.duration_s)}{rounds}"
