"""The removal of each reaction of SAFETY.md: `reactions.toml`, read and checked."""

from __future__ import annotations

import ast
import tomllib
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FILE = Path(__file__).with_name("reactions.toml")
_KEYS = {"row", "file", "text", "becomes", "test"}


@dataclass(frozen=True, slots=True)
class Removal:
    """A removed reaction: in `file`, `text` (which stands there once) becomes `becomes`, and `test` must fail.

    row: the row of SAFETY.md's table. test: a pytest node id.
    """

    row: str
    file: str
    text: str
    becomes: str
    test: str

    def apply(self, source: str) -> str:
        """Return the source of `file` without the reaction.

        Raises:
            ValueError: the text does not stand there exactly once, or what remains is no Python.
        """
        count = source.count(self.text)
        if count != 1:
            raise ValueError(f"{self.row}: the text {self.text!r} stands {count} times in {self.file}, not once")
        if self.text == self.becomes:
            raise ValueError(f"{self.row}: nothing is removed from {self.file}")
        changed = source.replace(self.text, self.becomes)
        if self.file.endswith(".py"):
            try:
                ast.parse(changed)
            except SyntaxError as error:
                raise ValueError(f"{self.row}: {self.file} is no Python any more: {error}") from error
        return changed


def read_removals(path: Path = FILE) -> tuple[Removal, ...]:
    """Return the removals in the file, in its order.

    Raises:
        ValueError: an entry has a key too few or too many, or a value that is no text.
    """
    entries = tomllib.loads(path.read_text(encoding="utf-8"))["removal"]
    for number, entry in enumerate(entries, start=1):
        if set(entry) != _KEYS or not all(isinstance(value, str) for value in entry.values()):
            raise ValueError(f"{path.name}: removal {number} must have the texts {', '.join(sorted(_KEYS))}")
    return tuple(Removal(**entry) for entry in entries)


def names_of_tests(source: str) -> set[str]:
    """Return the tests of a file as the part of their node ids behind the file: `test_x` or `TestY::test_x`."""
    found: set[str] = set()
    for node in ast.parse(source).body:
        if isinstance(node, ast.FunctionDef):
            found.add(node.name)
        elif isinstance(node, ast.ClassDef):
            found |= {f"{node.name}::{each.name}" for each in node.body if isinstance(each, ast.FunctionDef)}
    return {name for name in found if name.rsplit("::", 1)[-1].startswith("test_")}
