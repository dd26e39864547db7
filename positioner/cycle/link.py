"""The result of a batch of frames, and what is remembered of the other nodes until the next one. Pure."""

from __future__ import annotations

from dataclasses import field
from typing import TYPE_CHECKING

from positioner.cycle.frame_period import FramePeriod
from positioner.cycle.plausibility import ReadingHistory
from positioner.values import dataclass

if TYPE_CHECKING:
    from collections.abc import Mapping

    from positioner.cycle.events import Event
    from positioner.guard.state import GuardInput
    from positioner.wire.messages import Message
    from positioner.wire.window import Sender


@dataclass(frozen=True, slots=True)
class FeedbackState:
    """What is remembered of the position frames.

    counter: of the newest frame whose reading was used; periods_unread: sample periods since that frame.
    """

    readings: ReadingHistory = field(default_factory=ReadingHistory)
    frame_period: FramePeriod = field(default_factory=FramePeriod)
    counter: int | None = None
    periods_unread: int = 0


@dataclass(frozen=True, slots=True)
class LastSetpoint:
    """The newest usable setpoint of the host, and the counter of its frame; None before the first."""

    position_m: float | None = None
    counter: int | None = None


@dataclass(frozen=True, slots=True)
class LinkState:
    """What is remembered of the other nodes between cycles.

    pressure_pa: the newest one; pressure_is_new: whether no reading has come with it or since.
    """

    senders: Mapping[type[Message], Sender] = field(default_factory=dict)
    feedback: FeedbackState = field(default_factory=FeedbackState)
    setpoint: LastSetpoint = field(default_factory=LastSetpoint)
    pressure_pa: float | None = None
    pressure_is_new: bool = False


@dataclass(frozen=True, slots=True)
class Reading:
    """A plausible position reading: its frame's counter, and how many sample periods lie between it and the last.

    command_counter: of the command that acted; obeys: whether the node's actuator obeys commands.
    pressure_is_new: whether the newest pressure came with this reading, or since the one before.
    """

    position_m: float
    counter: int | None
    command_counter: int | None
    periods: int
    obeys: bool = True
    pressure_is_new: bool = False


@dataclass(frozen=True, slots=True)
class Received:
    """The result of a batch of frames."""

    link: LinkState
    reading: Reading | None
    guard_input: GuardInput
    events: tuple[Event, ...]
