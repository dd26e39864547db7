"""How every command begins and ends: its parser, its exit status, its one line of error. Shell."""

from __future__ import annotations

import argparse
import errno
import logging
import os
import sys
from contextlib import closing
from typing import TYPE_CHECKING, Any, NoReturn

from positioner.errors import ConfigurationError, ExitCode, PositionerError, in_one_line, visible
from positioner.inputs.nearest import did_you_mean, nearest
from positioner.machine.line_sink import LineSink
from positioner.machine.plain_text import replace_unknown_characters
from positioner.start import TRACEBACK, unexpected

if TYPE_CHECKING:
    from collections.abc import Callable

INTERRUPTED = 130
"""128 + SIGINT, as shells count it."""
_LINE_TIMEOUT_S = 1.0
"""How long the last line may wait until somebody reads it."""
_FULL = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})
_LAST_STANDARD = 2


class Parser(argparse.ArgumentParser):
    """Answers an unknown name or option with the nearest known one; so do the parsers of sub-commands."""

    def parse_known_args(self, *arguments: Any, **named: Any) -> Any:
        """Refuse what the command does not take, in its name: argparse would leave it to the whole program."""
        parsed, unknown = super().parse_known_args(*arguments, **named)
        if unknown:
            option = unknown[0].partition("=")[0]
            close = did_you_mean(option, self._option_string_actions) if option.startswith("-") else ""
            self.error(f"{option} is unknown; {close}{self.prog} --help lists what there is")
        return parsed, unknown

    def error(self, message: str) -> NoReturn:
        """End with the usage and an error of one line."""
        super().error(in_one_line(message))

    def _print_message(self, message: str, file: Any = None) -> None:
        """Print a help or an error without characters that a terminal would obey."""
        super()._print_message(visible(message), file)

    def _check_value(self, action: argparse.Action, value: object) -> None:
        """Refuse a `value` that is none of the action's choices.

        Raises:
            ArgumentError: it is none.
        """
        if action.choices is not None and value not in action.choices:
            known = nearest(str(value), map(str, action.choices))
            raise argparse.ArgumentError(action, f"{value!r} is unknown; {known}")


def run_command(parser: argparse.ArgumentParser, arguments: list[str] | None) -> int:
    """Run the function that `parser` sets as `run` for the command in `arguments`; return the exit status."""
    try:
        _open_standard_streams()
        replace_unknown_characters()
        for library in ("can", "cantools"):  # they raise, too, the errors that they log: one report is enough
            logging.getLogger(library).addHandler(logging.NullHandler())
            logging.getLogger(library).propagate = False
        parsed = parser.parse_args(arguments)
        command: Callable[[argparse.Namespace], ExitCode] = parsed.run
        code = int(command(parsed))
        sys.stdout.flush()
    except PositionerError as error:
        text = str(error)
        return _end(parser, text if isinstance(error, ConfigurationError) else in_one_line(text), error.exit_code)
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:  # the reader has gone
        _discard_output()
        return int(ExitCode.OK)
    except Exception as error:
        if isinstance(error, OSError) and error.errno in _FULL and error.filename is None:
            _discard_output()
            return _end(parser, f"nothing more can be written: {error.strerror}", ExitCode.IO)
        if os.environ.get(TRACEBACK):
            raise
        return _end(parser, *unexpected(error))
    return code


def _discard_output() -> None:
    """Drop the text that is still buffered, or the interpreter would complain when it ends."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _end(parser: argparse.ArgumentParser, line: str, code: int) -> int:
    with closing(LineSink.of(sys.stderr)) as sink:
        sink.write(visible(f"{parser.prog}: {line}"), _LINE_TIMEOUT_S)
    return int(code)


def _open_standard_streams() -> None:
    """Open /dev/null for each standard stream that is closed: no other file may get its number."""
    while (descriptor := os.open(os.devnull, os.O_RDWR)) <= _LAST_STANDARD:
        pass
    os.close(descriptor)
    if sys.stdout is None:
        sys.stdout = os.fdopen(1, "w", closefd=False)
    if sys.stderr is None:
        sys.stderr = os.fdopen(_LAST_STANDARD, "w", closefd=False)
