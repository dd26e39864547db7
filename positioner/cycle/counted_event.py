"""The base class of the events that are counted, each under a member of `Counted`. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.values import dataclass

if TYPE_CHECKING:
    from positioner.wire.messages import Counted


@dataclass(frozen=True, slots=True, kw_only=True)
class CountedEvent:
    """An event that is counted: under which cause, and how often it occurred."""

    counted: Counted
    count: int = 1
