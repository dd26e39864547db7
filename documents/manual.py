"""`python -m documents.manual FOLDER`: the man pages of both programs, in man(7), from their parsers. Shell."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from documents.commands import blocks, programs
from positioner import __version__

if TYPE_CHECKING:
    from documents.commands import Command

_SIGNS = str.maketrans({"\\": "\\e", "-": "\\-", "'": "\\(aq", "`": "\\(ga", "^": "\\(ha", "~": "\\(ti"})
"""What troff would read as a sign of its own, or print as a typographic one."""


def pages() -> dict[str, str]:
    """Return each page by its file name: one for each program, and one for each of its commands."""
    found = {}
    for program in programs():
        found[_file(program)] = _page(program, [each for each in programs() if each.words != program.words])
        for command in program.commands:
            found[_file(command)] = _page(command, [program])
    return found


def _file(command: Command) -> str:
    return f"{_name(command)}.1"


def _name(command: Command) -> str:
    return "-".join(command.words)


def _page(command: Command, beside: list[Command]) -> str:
    lines = [
        f'.TH {_name(command).upper()} 1 "" "positioner {__version__}" "User Commands"',
        ".SH NAME",
        f"{_text(_name(command))} \\- {_text(_short(command))}",
        ".SH SYNOPSIS",
        *_as_it_is(command.usage),
        ".SH DESCRIPTION",
        _text(command.summary),
        *_options(command, ".SH OPTIONS"),
    ]
    program = len(command.words) == 1
    if command.commands:
        lines.append(".SH COMMANDS")
    for inner in command.commands:
        if program:
            lines += [".TP", f".BR {_text(_name(inner))} (1)", _text(inner.summary)]
        else:
            lines += [f".SS {_text(' '.join(inner.words))}", _text(inner.summary), *_as_it_is(inner.usage)]
            lines += [*_options(inner, ""), *_end(inner)]
    lines += [*([".SH NOTES"] if command.epilog else []), *_end(command), ".SH SEE ALSO"]
    lines += [f".BR {_text(_name(each))} (1)" for each in beside]
    return "\n".join(line for line in lines if line) + "\n"


def _short(command: Command) -> str:
    first = command.summary.split(". ")[0].rstrip(".")
    return first[:1].lower() + first[1:]


def _options(command: Command, heading: str) -> list[str]:
    lines = [heading]
    for option in command.options:
        lines += [".TP", f".B {_text(option.written)}", _text(option.text)]
    return lines


def _end(command: Command) -> list[str]:
    lines = []
    for text, as_it_is in blocks(command.epilog):
        lines += _as_it_is(text) if as_it_is else [".PP", _text(text)]
    return lines


def _as_it_is(text: str) -> list[str]:
    """Return lines that are not filled."""
    return [".PP", ".nf", *(_text(line, keep=True) for line in text.splitlines()), ".fi"]


def _text(text: str, *, keep: bool = False) -> str:
    """Return text in which troff reads no sign of its own; one line, but for the spaces to `keep`."""
    plain = (text if keep else " ".join(text.split())).translate(_SIGNS)
    return f"\\&{plain}" if plain.startswith((".", "\\(aq")) else plain


def main() -> None:
    """Write the pages into the folder on the command line."""
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in pages().items():
        (folder / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
