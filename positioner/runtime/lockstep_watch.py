"""Whether the plant of a lockstep waits: one that does not is a real one, and its frames would be the clock. Shell."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.errors import UsageError
from positioner.wire.messages import StemPosition

if TYPE_CHECKING:
    from positioner.wire.codec import Codec
    from positioner.wire.messages import CanFrame

_MOST_UNANSWERED = 3


class LockstepWatch:
    """Counts the position frames that came while none was answered; a plant in lockstep sends one and waits."""

    def __init__(self, codec: Codec) -> None:
        """Begin before the first frame."""
        self._position = codec.identifier(StemPosition)
        self._unanswered = 0

    def count(self, frames: tuple[CanFrame, ...], *, answered: bool) -> None:
        """Take a turn's frames, and whether it sent a command.

        Raises:
            UsageError: the plant does not wait.
        """
        self._unanswered += sum((frame.arbitration_id, frame.is_extended) == self._position for frame in frames)
        if self._unanswered > _MOST_UNANSWERED:
            raise UsageError(
                f"{self._unanswered} position frames came without an answer: this plant does not wait, and --clock "
                "lockstep is for one that does; leave it out"
            )
        self._unanswered = 0 if answered else self._unanswered
