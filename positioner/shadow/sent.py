"""What a law that is not obeyed believes to have sent. Pure.

Most laws compute with the current that acted on the valve (`Observation.applied_ma`), whoever chose it. Quasi-static
moves compute the pressure from the current that they have answered with. In the shadow they are given the current that
was sent in its place. A move that the valve does not make never comes to its end then: its current stays, and the law
begins again, with what it has learned, once the setpoint has changed.
"""

from __future__ import annotations

from typing import Any

from positioner.laws.nmpc.law import NmpcLaw
from positioner.laws.nmpc.memory import NmpcMemory
from positioner.values import replace


def with_sent(memory: Any, current_ma: float | None) -> Any:
    """Return the memory of a law in whose place `current_ma` was sent; None where nothing was."""
    if current_ma is None:
        return memory
    if isinstance(memory, NmpcMemory):
        return memory if memory.sent_ma == current_ma else replace(memory, sent_ma=current_ma)
    return memory


def at_new_setpoint(law: Any, memory: Any, measured_m: float | None) -> Any:
    """Return the memory of a law whose last move was not made, at another setpoint, with the stem at `measured_m`."""
    if measured_m is None:
        return memory
    if isinstance(law, NmpcLaw) and memory.move.stage is not None:
        return law.resumed(memory, measured_m)
    return memory
