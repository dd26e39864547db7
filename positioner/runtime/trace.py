"""The trace of a run: one CSV row for each closed cycle, for pictures and analysis. Shell.

A row that learned has its samples as JSON, with the fit, in the column `learned`: so the table of any instant follows
from the one at the start.
"""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import TYPE_CHECKING

from positioner.cycle.events import Controlled, Event, Learned
from positioner.machine.journal import Log, logger
from positioner.runtime.output_file import OutputFile

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

_HEADER = (
    "time_s,setpoint_m,measured_m,position_m,velocity_m_per_s,stuck,current_ma,current_low_ma,current_high_ma,"
    "speed_low_m_per_s,speed_high_m_per_s,mode,motion,passes,table_sequence,learned,fallback,reason\n"
)


class TraceWriter:
    """Writes the rows of a trace."""

    def __init__(self, path: Path | None, log: Log = logger) -> None:
        """Create `path` with its header; without one nothing is written.

        Raises:
            UsageError: it cannot be written.
        """
        self._file = OutputFile("trace", path, log)
        self._file.write(_HEADER)
        self.close = self._file.close

    def cycle(self, events: Sequence[Event]) -> None:
        """Append the closed cycle among `events`, if there is one, with the samples that it learned."""
        if not self._file.is_open:
            return
        learned = [asdict(event.sample) for event in events if isinstance(event, Learned)]
        for event in events:
            if isinstance(event, Controlled):
                self._file.write(_row(event, _quoted(json.dumps(learned)) if learned else ""))


def _row(cycle: Controlled, learned: str) -> str:
    stem, decision = cycle.stem, cycle.decision
    bounds = decision.bounds
    return (
        f"{cycle.time_s:.6f},{cycle.setpoint_m:.8f},{cycle.measured_m:.8f},{stem.position_m:.9f},"
        f"{stem.velocity_m_per_s:.9f},{stem.stuck:d},{cycle.current_ma:.6f},{bounds.current_low_ma:.6f},"
        f"{bounds.current_high_ma:.6f},{bounds.speed_low_m_per_s:.6f},{bounds.speed_high_m_per_s:.6f},"
        f"{cycle.mode:d},{decision.motion:d},{decision.passes},{cycle.table_sequence},"
        f"{learned},{_cell(decision.fallback)},{_cell(str(decision.reason or ''))}\n"
    )


def _quoted(text: str) -> str:
    return '"' + text.replace('"', '""') + '"'


def _cell(words: str) -> str:
    return words.replace(",", ";")
