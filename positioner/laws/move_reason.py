"""Why a law begins a move, and where the breakaway current of that move comes from. Pure."""

from __future__ import annotations

import re
from enum import StrEnum

from positioner.values import dataclass


class BreakawaySource(StrEnum):
    """What a breakaway current Γ was computed from; the value is its name in texts."""

    TABLE = "the table"
    """A cell of the stiction table."""
    MODEL = "the model"
    """The estimated spring rate and static friction."""


@dataclass(frozen=True, slots=True)
class Breakaway:
    """Γ in mA, and the samples of the stiction table from which it was computed: their number, 0 without the table.

    age: how many samples the table has learned since the newest of them.
    """

    current_ma: float
    samples: int = 0
    age: int = 0

    @property
    def source(self) -> BreakawaySource:
        """What Γ was computed from."""
        return BreakawaySource.TABLE if self.samples else BreakawaySource.MODEL


@dataclass(frozen=True, slots=True)
class Believed:
    """What a law that measures the valve believes of it when a move begins: each number, and its σ.

    spring_n_per_m: K; offset_n: bench set F_0 and the force of the process; static_n, coulomb_n: F_s and F_c; ends_m: σ
    of the place where the move will end.
    """

    spring_n_per_m: tuple[float, float]
    offset_n: tuple[float, float]
    static_n: tuple[float, float]
    coulomb_n: tuple[float, float]
    ends_m: float


@dataclass(frozen=True, slots=True)
class MoveReason:
    """The error in m that a move is to correct, and the breakaway current that the move begins with at least.

    aim_m: where the move is to end. It is not the setpoint where the move first backs off, or corrects a landing bias.
    believed: what is believed of the valve, None where the law takes it for the configured one.
    """

    error_m: float
    breakaway: Breakaway
    aim_m: float
    believed: Believed | None = None

    def __str__(self) -> str:
        """One sentence for the log and the trace; `source_in` and `current_in` read it."""
        samples = f" ({self.breakaway.samples} samples)" if self.breakaway.samples else ""
        from_where = f"breakaway {self.breakaway.current_ma:.3f} mA from {self.breakaway.source}{samples}"
        return f"error {1e3 * self.error_m:+.3f} mm; {from_where}"


_SOURCE = re.compile(f"breakaway (.*) mA from ({'|'.join(BreakawaySource)})")


def source_in(text: str) -> BreakawaySource | None:
    """Return the source that the text of a `MoveReason` names, None where no move began."""
    found = _SOURCE.search(text)
    return BreakawaySource(found[2]) if found else None


def current_in(text: str) -> float | None:
    """Return the breakaway current in mA that the text of a `MoveReason` names, None where no move began."""
    found = _SOURCE.search(text)
    return float(found[1]) if found else None
