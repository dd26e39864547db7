"""Whether there is one sender under an identifier: the window of AUTOSAR's E2E state machine over its counters. Pure.

The frames of two senders under one identifier all have a valid CRC; only their counters, which interleave, differ. A
single error is a restart, a long loss or a replay; repeated errors are a second sender, and then neither is believed.

Source: AUTOSAR FO R22-11 "E2E Protocol Specification", E2E state machine. The states INIT and VALID are one here, since
no command is sent before a host arms. NoNewData is not a state here: the guard keeps the age of accepted data instead.
A frame that was overtaken (late) or came twice, the same to the bit, is no error.
"""

from __future__ import annotations

from dataclasses import field

from positioner.values import dataclass
from positioner.wire.e2e import CounterCheck, Sequence

WINDOW_FRAMES = 64
MAX_ERRORS = 3
"""WindowSizeStateValid and MaxErrorStateValid: one error in 16 frames is a second sender.

Two senders of one rate make an error of every second frame: they are disputed at the eighth frame.
"""
CLEAN_FRAMES = 16
"""WindowSizeStateInvalid, all of it without an error: so many frames in sequence end a dispute."""
SETTLED_FRAMES = 2
"""After an error so many frames in sequence are believed to be of one sender."""

_WINDOW_BITS = (1 << WINDOW_FRAMES) - 1
_CLEAN_BITS = (1 << CLEAN_FRAMES) - 1
_SETTLED_BITS = (1 << SETTLED_FRAMES) - 1


@dataclass(frozen=True, slots=True)
class SequenceWindow:
    """A sender's last frames: bit 0 of `errors` is the newest, set for a frame out of sequence."""

    errors: int = 0
    valid: bool = True

    @property
    def settled(self) -> bool:
        """Whether the window is valid and the newest frames were in sequence: their readings may be believed."""
        return self.valid and not self.errors & _SETTLED_BITS

    @property
    def why(self) -> str:
        """Why the sender's frames are not believed, in words."""
        if self.valid:
            return "its sender is in doubt: a frame came out of sequence just before"
        share = f"{self.errors.bit_count()} of the last {WINDOW_FRAMES} frames came out of sequence"
        return f"disputed: {share}; a second sender under its identifier? stop one of them"

    def after(self, *, error: bool) -> SequenceWindow:
        """Return the window after one more frame."""
        if not error and not self.errors:
            return self
        errors = (self.errors << 1 | error) & _WINDOW_BITS
        if self.valid:
            return SequenceWindow(errors, errors.bit_count() <= MAX_ERRORS)
        return SequenceWindow(errors, valid=False) if errors & _CLEAN_BITS else SequenceWindow()


@dataclass(frozen=True, slots=True)
class Sender:
    """The sender of one kind of frame: its counter, its window, its last bytes."""

    check: CounterCheck = field(default_factory=CounterCheck)
    window: SequenceWindow = field(default_factory=SequenceWindow)
    data: bytes = b""

    def receive(self, counter: int, data: bytes) -> tuple[Sender, Sequence, int]:
        """Return the sender after a frame, the result of its check, and how many frames were lost before it."""
        check, verdict, lost = self.check.check(counter)
        if verdict is Sequence.FRESH:
            return Sender(check, self.window.after(error=False), data), verdict, lost
        harmless = verdict is Sequence.LATE or (verdict is Sequence.REPEATED and data == self.data)
        window = self.window if harmless else self.window.after(error=True)
        return Sender(check, window, self.data), verdict, lost
