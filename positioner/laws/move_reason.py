"""Why a law begins a move, and with which breakaway current. Pure."""

from __future__ import annotations

import re

from positioner.values import dataclass


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
    """The error in m that a move is to correct, and the breakaway current in mA that frees the stem.

    aim_m: where the move is to end. It is not the setpoint where the stem is first moved away.
    believed: what is believed of the valve, None where the law takes it for the configured one.
    """

    error_m: float
    breakaway_ma: float
    aim_m: float
    believed: Believed | None = None

    def __str__(self) -> str:
        """One sentence for the log and the trace; `current_in` reads it."""
        return f"error {1e3 * self.error_m:+.3f} mm; breakaway {self.breakaway_ma:.3f} mA"


_CURRENT = re.compile(r"breakaway (\S+) mA")
"""In traces of earlier versions there follows where the current came from."""


def current_in(text: str) -> float | None:
    """Return the breakaway current in mA that the text of a `MoveReason` names, None where no move began."""
    found = _CURRENT.search(text)
    return float(found[1]) if found else None
