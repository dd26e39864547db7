"""A frame as a bus gives it, before the port knows when it arrived, and what gives such frames. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, TypeAlias

if TYPE_CHECKING:
    from positioner.wire.messages import CanFrame

RawFrame: TypeAlias = tuple[int, bytes, bool, bool, bool, float]
"""Identifier, data, whether it is extended, an error or a remote frame, and the kernel's stamp (s, wall clock)."""


ROOM_WITHIN_S = 0.05
"""How long a frame may wait for room in a full transmit queue, where nothing else waits meanwhile."""


class NoFrameError(ValueError):
    """What came is no CAN frame; the bus itself is sound."""


class Link(Protocol):
    """The way of frames to and from a bus that is open."""

    def receive(self, timeout_s: float) -> RawFrame | None:
        """Return the next frame, None if none comes within `timeout_s`.

        Raises:
            NoFrameError: what came is none.
            OSError: the bus does not work; python-can's CanError means the same.
        """

    def send(self, frame: CanFrame, room_within_s: float = ROOM_WITHIN_S) -> None:
        """Send `frame`; where the transmit queue is full, wait up to `room_within_s` for room.

        Raises:
            OSError: the bus does not take it; python-can's CanError means the same.
        """

    def close(self) -> None:
        """Close what the link has opened, not the bus."""
