"""What a command prints: lines and tables for the terminal, a pipe or a document, or one JSON document. Shell.

In a terminal the tables fit its width; in a pipe or a file they are plain aligned text. Markdown is printed only where
it is asked for. Progress and notes go to the standard error: they are no part of the result.
"""

from __future__ import annotations

import json
import math
import sys
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from positioner.errors import in_one_line, visible
from positioner.machine.plain_text import showable
from positioner.report.text import markdown, plain

if TYPE_CHECKING:
    import argparse
    from collections.abc import Iterable
    from typing import TextIO

    from positioner.report.text import Block


def add_output(parser: argparse.ArgumentParser) -> None:
    """Add `--json` and `--markdown`, which exclude each other."""
    which = parser.add_mutually_exclusive_group()
    add_json(which)
    which.add_argument("--markdown", action="store_true", help="print tables in Markdown, for a document")


def add_json(parser: argparse._ActionsContainer) -> None:
    """Add `--json`."""
    parser.add_argument("--json", action="store_true", help="print one JSON document instead of text")


def show(blocks: Iterable[Block], *, as_markdown: bool = False) -> None:
    """Print lines and tables to the standard output."""
    stream = sys.stdout
    found = [_in_characters_of(stream, block) for block in blocks]
    if as_markdown:
        stream.write(markdown(found))
    elif stream.isatty():
        from positioner.cli.drawn_tables import draw  # noqa: PLC0415 - rich, for a terminal only

        draw(found, stream)
    else:
        stream.write(showable(plain(found), stream))
    stream.flush()


def below(lines: Iterable[str]) -> list[str]:
    """Return sentences as the list that follows a table."""
    found = [f"- {line}" for line in lines]
    return ["", *found] if found else []


def show_json(document: Any) -> None:
    """Print the only document of a command to the standard output; NaN and infinities, which JSON has not, are null."""
    is_ascii = showable("µ", sys.stdout) != "µ"
    sys.stdout.write(visible(json.dumps(finite(document), indent=2, ensure_ascii=is_ascii, allow_nan=False)) + "\n")
    sys.stdout.flush()


def show_result(arguments: argparse.Namespace, blocks: Iterable[Block], values: str) -> None:
    """Print what the options of `add_output` ask for: the blocks, or `values`, the text of their JSON document."""
    if arguments.json:
        show_json(json.loads(values))
    else:
        show(blocks, as_markdown=arguments.markdown)


def put(line: str) -> None:
    """Print a line, or some, that is the result as it is: it has no marks."""
    sys.stdout.write(f"{showable(line, sys.stdout)}\n")


def note(line: str) -> None:
    """Print a line that is no part of the result."""
    sys.stderr.write(f"{showable(line, sys.stderr)}\n")


def finite(value: Any) -> Any:
    """Return a document for JSON with None in place of numbers that JSON has not."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: finite(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [finite(each) for each in value]
    return value


def _in_characters_of(stream: TextIO, block: Block) -> Block:
    """Return the block as the stream can show it, before columns are aligned: ≤ is wider in ASCII."""
    if isinstance(block, str):
        return showable(block, stream)
    return replace(
        block,
        head=tuple(showable(in_one_line(cell), stream) for cell in block.head),
        rows=tuple(tuple(showable(in_one_line(cell), stream) for cell in row) for row in block.rows),
        caption=showable(in_one_line(block.caption), stream),
    )
