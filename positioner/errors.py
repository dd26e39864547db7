"""The exception tree: every error that a user may see, carrying the values that failed.

Exit statuses follow sysexits.h: by them a service manager distinguishes a mistake in a file (never worth a restart)
from a bus that is away (always worth one).
"""

from __future__ import annotations

import errno
import re
from contextlib import contextmanager
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


class ExitCode(IntEnum):
    """Exit statuses of every command; documented in docs/commands.md."""

    OK = 0
    FAILURE = 1
    USAGE = 2
    DATA = 65
    UNAVAILABLE = 69
    SOFTWARE = 70
    SYSTEM = 71
    IO = 74
    TEMPORARY = 75
    CONFIG = 78


TEMPORARY_ERRNOS = frozenset(
    {errno.ENOMEM, errno.EIO, errno.EMFILE, errno.ENFILE, errno.ENOSPC, errno.EAGAIN, errno.EINTR}
)
"""Errors of system calls that may pass: no mistake in a file, and worth another start."""


class PositionerError(Exception):
    """Base of all errors of the project; `exit_code` is the exit status of the command."""

    exit_code: ExitCode = ExitCode.FAILURE


@dataclass(frozen=True, slots=True)
class Problem:
    """One mistake in a configuration: its place, and a message that says how to correct it."""

    where: str
    line: int | None
    message: str

    def __str__(self) -> str:
        """One line: `line 12: valve.mass_kg = 1361: must be at most 200`; a very long text is cut."""
        where, message = (shortened(in_one_line(text)) for text in (self.where, self.message))
        return f"line {self.line}: {where}: {message}" if self.line else f"{where}: {message}"


_OBEYED = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")
"""Control characters (ISO 6429), separators of lines, and what changes the direction of a text (Unicode, UAX 9)."""


def visible(text: str) -> str:
    r"""Return a text with the characters that a terminal would obey and not show written as \u001b; its lines stay.

    Names and units in files, and the names of files, are other people's: an escape sequence among them could clear the
    screen, or write what nobody has said.
    """
    return _OBEYED.sub(lambda found: f"\\u{ord(found[0]):04x}", text)


def in_one_line(text: str) -> str:
    r"""Return a text as `visible`, with its line breaks written as \n: one line of a message or a log stays one."""
    return visible(text).replace("\n", "\\n")


_LONGEST_SHOWN = 600


def shortened(text: str) -> str:
    """Return the text, cut where it is longer than a message should be."""
    return text if len(text) <= _LONGEST_SHOWN else f"{text[:_LONGEST_SHOWN]}…"


class ConfigurationError(PositionerError):
    """A configuration that cannot be used; `problems` holds every mistake found, `source` the file."""

    exit_code = ExitCode.CONFIG

    def __init__(self, source: str, problems: tuple[Problem, ...]) -> None:
        self.source = source
        self.problems = problems
        super().__init__("\n".join(f"{in_one_line(source)}: {problem}" for problem in problems))

    def __reduce__(self) -> tuple[type[ConfigurationError], tuple[str, tuple[Problem, ...]]]:
        """Return what a worker's error is made of again in the process that waits for it."""
        return type(self), (self.source, self.problems)


class BusError(PositionerError):
    """The CAN bus cannot be used; the message names the bus and a remedy."""

    exit_code = ExitCode.UNAVAILABLE


class BusUnusableError(BusError):
    """No such bus can be used on this machine as it is; no restart helps."""

    exit_code = ExitCode.CONFIG


class AlreadyRunningError(PositionerError):
    """Another process holds this valve's state, for now: a daemon, its table writer that still writes, or a command."""

    exit_code = ExitCode.TEMPORARY


class AnotherControllerError(PositionerError):
    """Another controller commands this valve on the bus, and goes on doing so."""

    exit_code = ExitCode.UNAVAILABLE


class StateError(PositionerError):
    """The state directory or its table cannot be used."""

    exit_code = ExitCode.IO


class RecordError(PositionerError):
    """A record of a loop that cannot be diagnosed: it cannot be read, or what is needed is not in it."""

    exit_code = ExitCode.IO


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn an OSError of the `with` block into a StateError with the file's name, or `path` where it has none."""
    try:
        yield
    except OSError as error:
        raise StateError(f"{error.filename or path}: cannot be written: {error.strerror}") from error


class UsageError(PositionerError):
    """An argument of a command that cannot be used."""

    exit_code = ExitCode.USAGE


class HostError(PositionerError):
    """The host was asked for something that cannot be done now, or that the positioner did not do."""


class BenchError(PositionerError):
    """A bench run could not be completed."""
