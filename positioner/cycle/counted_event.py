"""What makes an event count: the member of `Counted` that it names. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from positioner.wire.messages import Counted


@dataclass(frozen=True, slots=True, kw_only=True)
class CountedEvent:
    """An event that is counted: as what, and how often it occurred."""

    counted: Counted
    count: int = 1
