"""How every command ends: its status, its one line of error, its silence when nobody reads any more. Shell."""

from __future__ import annotations

import errno
import logging
import os
import sys
from contextlib import closing
from typing import TYPE_CHECKING

import argcomplete

from positioner.errors import ExitCode, PositionerError
from positioner.line_sink import LineSink
from positioner.plain_text import speak_plainly

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable

INTERRUPTED = 130
"""128 + SIGINT, as shells count it."""
_PATIENCE_S = 1.0
"""How long the last line may wait for somebody to read it."""
_NOT_WRITTEN = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EIO, errno.EFBIG, errno.EBADF})
_LAST_STANDARD = 2


def run_command(parser: argparse.ArgumentParser, arguments: list[str] | None) -> int:
    """Return the exit status of the command that `parser` finds in `arguments` and that its `run` default names."""
    _open_standard_streams()
    speak_plainly()
    argcomplete.autocomplete(parser)
    logging.getLogger("can").addHandler(logging.NullHandler())  # what it cannot do it raises, too: told once, by us
    logging.getLogger("can").propagate = False
    parsed = parser.parse_args(arguments)
    command: Callable[[argparse.Namespace], ExitCode] = parsed.run
    try:
        code = int(command(parsed))
        sys.stdout.flush()
    except PositionerError as error:
        return _tell(parser, str(error), error.exit_code)
    except KeyboardInterrupt:
        return INTERRUPTED
    except OSError as error:
        if error.filename is not None or error.errno not in {errno.EPIPE, *_NOT_WRITTEN}:
            raise
        # what is still buffered goes nowhere, or the interpreter would complain when it ends
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if error.errno == errno.EPIPE:  # the reader has gone, and wants no more
            return int(ExitCode.OK)
        return _tell(parser, f"the output cannot be written: {error.strerror}", ExitCode.IO)
    return code


def _tell(parser: argparse.ArgumentParser, line: str, code: ExitCode) -> int:
    with closing(LineSink.of(sys.stderr)) as sink:
        sink.write(f"{parser.prog}: {line}", _PATIENCE_S)
    return int(code)


def _open_standard_streams() -> None:
    """Put /dev/null in the place of a standard stream that was closed: no file of ours must get its number."""
    while (descriptor := os.open(os.devnull, os.O_RDWR)) <= _LAST_STANDARD:
        pass
    os.close(descriptor)
    if sys.stdout is None:
        sys.stdout = os.fdopen(1, "w", closefd=False)
    if sys.stderr is None:
        sys.stderr = os.fdopen(_LAST_STANDARD, "w", closefd=False)
