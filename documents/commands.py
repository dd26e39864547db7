"""The commands as their parsers describe them: for the reference of the site and the man pages. Pure."""

from __future__ import annotations

import argparse
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

import plant_emulator.cli.main
import positioner.cli.main

if TYPE_CHECKING:
    from collections.abc import Iterator

_WIDTH = 100
_PARTS = re.compile(r"\n(?=\S[^\n]*:\n  )|\n\n|(?<=:)\n(?=  )|\n(?=(?:exit status|completion):)")
"""Between the parts of what a help ends with: an empty line, a heading, and what stands under it."""


@dataclass(frozen=True)
class Option:
    """An option or an argument: how it is written, and what it does."""

    written: str
    text: str


@dataclass(frozen=True)
class Command:
    """A command: its words, what it does, its usage, its options, what its help ends with, its own commands."""

    words: tuple[str, ...]
    summary: str
    usage: str
    options: tuple[Option, ...]
    epilog: str
    commands: tuple[Command, ...]

    def all(self) -> Iterator[Command]:
        """Yield this command and every one below it."""
        yield self
        for each in self.commands:
            yield from each.all()


def programs() -> tuple[Command, Command]:
    """Return both programs with all their commands."""
    emulator, own = plant_emulator.cli.main.build_parser(), positioner.cli.main.build_parser()
    return _command(own, ("positioner",)), _command(emulator, ("plant-emulator",))


def page(program: Command) -> str:
    """Return the reference of a program in Markdown."""
    return f"# {program.words[0]}\n\n" + "\n".join(_section(each) for each in program.all())


def blocks(epilog: str) -> Iterator[tuple[str, bool]]:
    """Yield the parts of what a help ends with, and of each whether its lines stand as they are, as examples do."""
    for part in _PARTS.split(epilog.strip("\n")):
        if part.strip():
            yield part.rstrip(), part.startswith("  ")


def _command(parser: argparse.ArgumentParser, words: tuple[str, ...]) -> Command:
    formatter = argparse.HelpFormatter(" ".join(words), width=_WIDTH)
    formatter.add_usage(parser.usage, parser._actions, parser._mutually_exclusive_groups)  # noqa: SLF001 - argparse has
    usage = formatter.format_help().removeprefix("usage: ").rstrip().replace("\n       ", "\n")  # no other way to that
    options, commands = [], []
    for action in parser._actions:  # noqa: SLF001
        if isinstance(action, argparse._SubParsersAction):  # noqa: SLF001
            commands += [_command(inner, (*words, name)) for name, inner in action.choices.items()]
        elif action.help != argparse.SUPPRESS:
            written = formatter._format_action_invocation(action)  # noqa: SLF001
            options.append(Option(written, formatter._expand_help(action) if action.help else ""))  # noqa: SLF001
    return Command(words, parser.description or "", usage, tuple(options), parser.epilog or "", tuple(commands))


def _section(command: Command) -> str:
    heading = [] if len(command.words) == 1 else [f"{'#' * len(command.words)} {' '.join(command.words)}\n"]
    lines = [*heading, f"{command.summary}\n", f"```text\n{command.usage}\n```\n"]
    if command.options:
        lines += ["| option | what it does |", "|---|---|"]
        lines += [f"| `{_cell(each.written)}` | {_cell(each.text)} |" for each in command.options]
        lines.append("")
    for text, as_it_is in blocks(command.epilog):
        lines.append(f"```text\n{text}\n```\n" if as_it_is else f"{_plain(text)}\n")
    return "\n".join(lines)


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def _plain(text: str) -> str:
    """Return running text of a help, whose signs Markdown must not read."""
    return re.sub(r"([*_<>|])", r"\\\1", " ".join(text.split()))
