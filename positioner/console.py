"""How every command ends: its status, its one line of error, its silence when nobody reads any more. Shell."""

from __future__ import annotations

import logging
import os
import sys
from typing import TYPE_CHECKING

import argcomplete

from positioner.errors import ExitCode, PositionerError

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable

INTERRUPTED = 130
"""128 + SIGINT, as shells count it."""


def run_command(parser: argparse.ArgumentParser, arguments: list[str] | None) -> int:
    """Return the exit status of the command that `parser` finds in `arguments` and that its `run` default names."""
    argcomplete.autocomplete(parser)
    logging.getLogger("can").addHandler(logging.NullHandler())  # what it cannot do it raises, too: told once, by us
    logging.getLogger("can").propagate = False
    parsed = parser.parse_args(arguments)
    command: Callable[[argparse.Namespace], ExitCode] = parsed.run
    try:
        code = int(command(parsed))
        sys.stdout.flush()
    except PositionerError as error:
        sys.stderr.write(f"{parser.prog}: {error}\n")
        return int(error.exit_code)
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:
        # the reader has gone: what is still buffered goes nowhere, or the interpreter would complain when it ends
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return int(ExitCode.OK)
    return code
