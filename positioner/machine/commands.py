"""The parser of a program, with those modules of commands that its command line needs. Shell.

`positioner --version` answers at once; `--help`, `--completion` and a mistake need every command.
"""

from __future__ import annotations

import argparse
import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

from positioner.machine.build import version
from positioner.machine.completion import Completion
from positioner.machine.console import Parser

if TYPE_CHECKING:
    from collections.abc import Sequence


def program_parser(
    program: str, number: str, text: tuple[str, str], package: str, names: Sequence[str], words: Sequence[str] | None
) -> Parser:
    """Return the parser of `program`, version `number`, with its commands; `text` stands above and below them.

    Every command is a module of `package`; all are there where `words` is None, or else those that the words need.
    """
    description, epilog = text
    parser = Parser(
        prog=program,
        description=description,
        epilog=epilog,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=version(program, number))
    parser.add_argument("--completion", action=Completion)
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    add_commands(commands, package, names, words)
    return parser


def add_commands(
    parsers: argparse._SubParsersAction[Any],
    package: str,
    names: Sequence[str],
    words: Sequence[str] | None,
) -> None:
    """Add those commands of `names` to `parsers` that `words` need; all where `words` is None.

    The command `step-test` is added by `add_parser` of the module `step_test` in `package`. A name that is only to be
    refused stands without its options.
    """
    first = words[0] if words else ""
    needed = names if words is None else [name for name in names if name == first]
    for name in names:
        if name in needed:
            import_module(f"{package}.{name.replace('-', '_')}").add_parser(parsers)
        elif not needed:
            parsers.add_parser(name)


def words_given(arguments: Sequence[str] | None = None) -> list[str] | None:
    """Return the words that say which commands are needed; None where the answer shows all of them."""
    words = sys.argv[1:] if arguments is None else list(arguments)
    return words if words == ["--version"] or (words and not words[0].startswith("-")) else None
