"""The trace of a run: one CSV row for each closed cycle, for pictures and analysis. Shell."""

from __future__ import annotations

from typing import TYPE_CHECKING, TextIO

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from positioner.cycle.events import Controlled, Learned

COLUMNS = (
    "time_s",
    "setpoint_m",
    "measured_m",
    "position_m",
    "velocity_m_per_s",
    "stuck",
    "current_ma",
    "current_low_ma",
    "current_high_ma",
    "speed_low_m_per_s",
    "speed_high_m_per_s",
    "mode",
    "motion",
    "passes",
    "table_sequence",
    "learned",
    "fallback",
    "reason",
)


class TraceWriter:
    """Writes the rows of a trace; the operating system does the buffering."""

    def __init__(self, path: Path) -> None:
        """Create `path` with its header."""
        self._file: TextIO = path.open("w", encoding="utf-8", buffering=1 << 16)
        self._file.write(",".join(COLUMNS) + "\n")

    def write(self, cycle: Controlled, learned: Sequence[Learned]) -> None:
        """Append one cycle, and the names of the quantities it taught, with + between them."""
        stem, decision = cycle.stem, cycle.decision
        bounds = decision.bounds
        taught = "+".join(lesson.sample.quantity for lesson in learned)
        self._file.write(
            f"{cycle.time_s:.6f},{cycle.setpoint_m:.8f},{cycle.measured_m:.8f},{stem.position_m:.9f},"
            f"{stem.velocity_m_per_s:.9f},{stem.stuck:d},{cycle.current_ma:.6f},{bounds.current_low_ma:.6f},"
            f"{bounds.current_high_ma:.6f},{bounds.speed_low_m_per_s:.6f},{bounds.speed_high_m_per_s:.6f},"
            f"{cycle.mode:d},{decision.motion:d},{decision.passes},{cycle.table_sequence},"
            f"{taught},{_cell(decision.fallback)},{_cell(str(decision.reason or ''))}\n"
        )

    def close(self) -> None:
        """Write what is left."""
        self._file.close()


def _cell(words: str) -> str:
    return words.replace(",", ";")
