"""The frames that a host owes the positioner, each kind at its period and with its counter. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.wire.messages import ManualCurrent, Setpoint

if TYPE_CHECKING:
    from positioner.wire.codec import Codec
    from positioner.wire.messages import CanFrame

EVERY_S: dict[type[Setpoint | ManualCurrent], float] = {Setpoint: 0.01, ManualCurrent: 0.05}
"""Periods in s, those of the DBC; shorter where the positioner's patience is."""
_FRAMES_IN_PATIENCE = 5
_NS = 1_000_000_000


class FrameSchedule:
    """Says when a frame is due, and numbers it."""

    def __init__(self, codec: Codec, patience_s: float) -> None:
        """Begin at once; `patience_s` is how long the positioner bears silence, 0 for ever."""
        self._codec = codec
        longest_s = patience_s / _FRAMES_IN_PATIENCE if patience_s else EVERY_S[ManualCurrent]
        self._every_ns = {kind: round(min(every_s, longest_s) * _NS) for kind, every_s in EVERY_S.items()}
        self._due_ns = dict.fromkeys(EVERY_S, 0)
        self._sent = dict.fromkeys(EVERY_S, 0)

    def frame(self, message: Setpoint | ManualCurrent, now_ns: int) -> tuple[CanFrame, ...]:
        """Return the frame of `message` where one of its kind is due, else nothing."""
        kind = type(message)
        if now_ns < self._due_ns[kind]:
            return ()
        late = now_ns - self._due_ns[kind] >= self._every_ns[kind]
        self._due_ns[kind] = (now_ns if late else self._due_ns[kind]) + self._every_ns[kind]
        self._sent[kind] += 1
        return (self._codec.encode(message, self._sent[kind] - 1),)

    def at_once(self, kind: type[Setpoint | ManualCurrent]) -> None:
        """Let the next frame of this kind be due."""
        self._due_ns[kind] = 0
