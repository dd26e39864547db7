"""When the frames of a host are due: each kind at its period and with its own counter. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.wire.messages import ManualCurrent, Setpoint

if TYPE_CHECKING:
    from positioner.wire.codec import Codec
    from positioner.wire.messages import CanFrame

EVERY_S: dict[type[Setpoint | ManualCurrent], float] = {Setpoint: 0.01, ManualCurrent: 0.05}
"""Periods in s, as in the DBC; shorter where the timeout of the positioner is short."""
_FRAMES_IN_TIMEOUT = 5
_NS = 1_000_000_000


class FrameSchedule:
    """Decides when a frame is due, and counts the frames of each kind."""

    def __init__(self, codec: Codec, timeout_s: float) -> None:
        """Begin with every kind due; the positioner goes to HOLD after `timeout_s` without a setpoint, 0 for never."""
        self._codec = codec
        longest_s = timeout_s / _FRAMES_IN_TIMEOUT if timeout_s else EVERY_S[ManualCurrent]
        self._every_ns = {kind: round(min(every_s, longest_s) * _NS) for kind, every_s in EVERY_S.items()}
        self._due_ns = dict.fromkeys(EVERY_S, 0)
        self._sent = dict.fromkeys(EVERY_S, 0)
        self._first = 0

    def frame(self, message: Setpoint | ManualCurrent, now_ns: int, counter: int | None = None) -> tuple[CanFrame, ...]:
        """Return the frame of `message` if a frame of its kind is due, else nothing; `counter`: not the own one."""
        kind = type(message)
        if now_ns < self._due_ns[kind]:
            return ()
        late = now_ns - self._due_ns[kind] >= self._every_ns[kind]
        self._due_ns[kind] = (now_ns if late else self._due_ns[kind]) + self._every_ns[kind]
        if counter is not None:
            return (self._codec.encode(message, counter),)
        self._sent[kind] += 1
        return (self._codec.encode(message, self._sent[kind] - 1),)

    def setpoints_sent(self) -> int:
        """Return how many setpoint frames were sent in the own sequence."""
        return self._sent[Setpoint] - self._first

    def follow(self, counter: int | None) -> None:
        """Let the first setpoint frame follow the one with this counter, which the positioner obeys; later, nothing."""
        if counter is not None and self.setpoints_sent() == 0:
            self._first = self._sent[Setpoint] = counter + 1

    def at_once(self, kind: type[Setpoint | ManualCurrent]) -> None:
        """Make the next frame of this kind due at once."""
        self._due_ns[kind] = 0
