"""Frames as messages of python-can, on every interface that is no socket of this machine. Shell."""

from __future__ import annotations

import select
from typing import TYPE_CHECKING

import can

from positioner.bus.opening import descriptor_of
from positioner.bus.raw_frame import ROOM_WITHIN_S

if TYPE_CHECKING:
    from positioner.bus.raw_frame import RawFrame
    from positioner.wire.messages import CanFrame


class MessageLink:
    """Receives and sends by the methods of python-can's `bus`."""

    def __init__(self, bus: can.BusABC) -> None:
        """Use `bus`, which stays open."""
        self._bus = bus
        self._descriptor = descriptor_of(bus)

    def receive(self, timeout_s: float) -> RawFrame | None:
        """Return the next frame, None if none comes within `timeout_s`.

        Raises:
            CanError: the bus does not work.
        """
        if timeout_s > 0.0 and self._descriptor is not None:
            # python-can waits by the wall clock: if that is set back, it would wait for that much longer
            select.select((self._descriptor,), (), (), timeout_s)
            timeout_s = 0.0
        message = self._bus.recv(timeout_s)
        if message is None:
            return None
        return (
            message.arbitration_id,
            bytes(message.data),
            message.is_extended_id,
            message.is_error_frame,
            message.is_remote_frame,
            message.timestamp,
        )

    def send(self, frame: CanFrame, room_within_s: float = ROOM_WITHIN_S) -> None:
        """Send `frame`.

        Raises:
            CanError: the bus does not take it.
        """
        message = can.Message(
            arbitration_id=frame.arbitration_id, data=frame.data, is_extended_id=frame.is_extended, check=False
        )
        self._bus.send(message, timeout=room_within_s)

    def close(self) -> None:
        """Do nothing: the bus is closed by who opened it."""
