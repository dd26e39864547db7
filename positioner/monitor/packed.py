"""The frames of a log in memory: 22 bytes each, so that an hour at 1 kHz takes 170 MB. Pure."""

from __future__ import annotations

from array import array

from positioner.wire.messages import CanFrame

_BYTES = 8
_EXTENDED, _ERROR, _REMOTE = 1, 2, 4


class PackedFrames:
    """Frames with their instants in ns, in order."""

    def __init__(self) -> None:
        """Begin empty."""
        self.times_ns = array("q")
        self._identifiers = array("I")
        self._flags, self._lengths = bytearray(), bytearray()
        self._data = bytearray()

    def __len__(self) -> int:
        return len(self.times_ns)

    def add(self, frame: CanFrame, time_ns: int) -> None:
        """Append a frame; of the data of a longer one than CAN has, only the length matters."""
        self.times_ns.append(time_ns)
        self._identifiers.append(frame.arbitration_id)
        self._flags.append(_EXTENDED * frame.is_extended | _ERROR * frame.is_error | _REMOTE * frame.is_remote)
        self._lengths.append(min(len(frame.data), 255))
        self._data += frame.data[:_BYTES].ljust(_BYTES, b"\0")

    def frame(self, number: int) -> CanFrame:
        """Return the frame `number`, from 0."""
        flags, length = self._flags[number], self._lengths[number]
        data = bytes(self._data[number * _BYTES : number * _BYTES + min(length, _BYTES)])
        return CanFrame(
            self._identifiers[number],
            data.ljust(length, b"\0"),
            bool(flags & _EXTENDED),
            bool(flags & _ERROR),
            bool(flags & _REMOTE),
        )
