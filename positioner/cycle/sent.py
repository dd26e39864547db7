"""What was sent: the newest commands, and the counters and instants of the frames. Pure."""

from __future__ import annotations

from positioner.values import dataclass


@dataclass(frozen=True, slots=True)
class SentCommand:
    """A command that was sent: its frame's counter (modulo 256) and its current."""

    counter: int
    current_ma: float


@dataclass(frozen=True, slots=True)
class OutputState:
    """What was sent: the commands since the last pause, counters of the frames, and when the last ones were sent.

    paused_ma: the current of the last command before a pause, None where there was none.
    """

    sent: tuple[SentCommand, ...] = ()
    paused_ma: float | None = None
    command_counter: int = 0
    command_ns: int = 0
    status_counter: int = 0
    status_ns: int | None = None

    @property
    def last_ma(self) -> float | None:
        """The current commanded last, None in a pause and before the first."""
        return self.sent[-1].current_ma if self.sent else None
