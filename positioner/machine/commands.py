"""Which modules of commands a command line needs: the others are not loaded. Shell.

`positioner --version` answers at once; `--help`, `--completion` and a mistake need every command.
"""

from __future__ import annotations

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import argparse
    from collections.abc import Sequence


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
