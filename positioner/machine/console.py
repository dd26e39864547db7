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
from positioner.machine.line_sink import LineSink
from positioner.machine.plain_text import speak_plainly
from positioner.start import TRACEBACK, unforeseen

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable

INTERRUPTED = 130
"""128 + SIGINT, as shells count it."""
_PATIENCE_S = 1.0
"""How long the last line may wait for somebody to read it."""
_FULL = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})
_LAST_STANDARD = 2


def run_command(parser: argparse.ArgumentParser, arguments: list[str] | None) -> int:
    """Return the exit status of the command that `parser` finds in `arguments` and that its `run` default names."""
    try:
        _open_standard_streams()
        speak_plainly()
        argcomplete.autocomplete(parser)
        for library in ("can", "cantools"):  # what they cannot do they raise, too: told once, by us
            logging.getLogger(library).addHandler(logging.NullHandler())
            logging.getLogger(library).propagate = False
        parsed = parser.parse_args(arguments)
        command: Callable[[argparse.Namespace], ExitCode] = parsed.run
        code = int(command(parsed))
        sys.stdout.flush()
    except PositionerError as error:
        return _tell(parser, str(error), error.exit_code)
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:  # the reader has gone, and wants no more
        _discard_output()
        return int(ExitCode.OK)
    except Exception as error:
        if isinstance(error, OSError) and error.errno in _FULL and error.filename is None:
            _discard_output()
            return _tell(parser, f"nothing more can be written: {error.strerror}", ExitCode.IO)
        if os.environ.get(TRACEBACK):
            raise
        return _tell(parser, *unforeseen(error))
    return code


def _discard_output() -> None:
    """Let what is still buffered go nowhere, or the interpreter would complain when it ends."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _tell(parser: argparse.ArgumentParser, line: str, code: int) -> int:
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
