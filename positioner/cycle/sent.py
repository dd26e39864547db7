"""What was sent: the newest commands, and the counters and instants of the frames. Pure."""

from __future__ import annotations

from positioner.values import dataclass

_REMEMBERED = 255
"""Commands by which a reading may be late; fewer where their counter wraps sooner: each counter names one command."""
_TOGETHER, _FULL = 16, 16
"""Commands in a tuple, and how many full ones are kept: one command more copies sixteen of 255, not all of them."""


@dataclass(frozen=True, slots=True)
class SentCommand:
    """A command that was sent: its frame's counter (modulo 256) and its current."""

    counter: int
    current_ma: float


@dataclass(frozen=True, slots=True)
class SentCommands:
    """The newest commands: full tuples and the newest ones, each oldest first."""

    full: tuple[tuple[SentCommand, ...], ...] = ()
    newest: tuple[SentCommand, ...] = ()

    @property
    def last(self) -> SentCommand | None:
        """The newest command, None where there is none."""
        if self.newest:
            return self.newest[-1]
        return self.full[-1][-1] if self.full else None

    def with_newest(self, command: SentCommand) -> SentCommands:
        """Return the commands after one more."""
        if len(self.newest) < _TOGETHER:
            return SentCommands(self.full, (*self.newest, command))
        return SentCommands((*self.full, self.newest)[-_FULL:], (command,))

    def without_newest(self) -> SentCommands:
        """Return the commands without the last one."""
        if self.full and not self.newest:
            return SentCommands(self.full[:-1], self.full[-1][:-1])
        return SentCommands(self.full, self.newest[:-1])

    def named(self, counter: int, modulus: int) -> SentCommand | None:
        """Return the newest command with this counter, None where it is forgotten or was never sent."""
        left = min(_REMEMBERED, modulus - 1)
        commands, before = self.newest, len(self.full)
        while left > 0:  # by index, in every cycle: a slice or an iterator costs more than the search
            for place in range(len(commands) - 1, max(len(commands) - left, 0) - 1, -1):
                if commands[place].counter == counter:
                    return commands[place]
            if before == 0:
                return None
            left, before = left - len(commands), before - 1
            commands = self.full[before]
        return None


NONE_SENT = SentCommands()


@dataclass(frozen=True, slots=True)
class OutputState:
    """What was sent: the commands since the last pause, counters of the frames, and when the last ones were sent.

    paused_ma: the current of the last command before a pause, None where there was none.
    """

    sent: SentCommands = NONE_SENT
    paused_ma: float | None = None
    command_counter: int = 0
    command_ns: int = 0
    status_counter: int = 0
    status_ns: int | None = None

    @property
    def last_ma(self) -> float | None:
        """The current commanded last, None in a pause and before the first."""
        last = self.sent.last
        return None if last is None else last.current_ma
