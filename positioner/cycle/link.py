"""What a batch of frames amounts to, and what is remembered of the other nodes until the next one. Pure."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from positioner.cycle.frame_period import FramePeriod
from positioner.cycle.plausibility import ReadingHistory

if TYPE_CHECKING:
    from collections.abc import Mapping

    from positioner.cycle.events import Event
    from positioner.guard.state import GuardInput
    from positioner.wire.messages import Message
    from positioner.wire.window import Sender


@dataclass(frozen=True, slots=True)
class LinkState:
    """What is remembered of the other nodes between cycles."""

    senders: Mapping[type[Message], Sender] = field(default_factory=dict)
    readings: ReadingHistory = field(default_factory=ReadingHistory)
    setpoint_m: float | None = None
    setpoint_counter: int | None = None
    pressure_pa: float | None = None
    periods_unread: int = 0
    position_counter: int | None = None
    frame_period: FramePeriod = field(default_factory=FramePeriod)


@dataclass(frozen=True, slots=True)
class Reading:
    """A plausible position reading: its frame's counter, and how many sample periods lie between it and the last.

    command_counter: of the command that acted; obeys: whether the node's actuator obeys commands.
    """

    position_m: float
    counter: int | None
    command_counter: int | None
    periods: int
    obeys: bool = True


@dataclass(frozen=True, slots=True)
class Received:
    """What a batch of frames amounts to."""

    link: LinkState
    reading: Reading | None
    guard_input: GuardInput
    events: tuple[Event, ...]
