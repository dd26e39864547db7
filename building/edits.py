"""Replacements in a text, with the line of the text from which each line of the result comes."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import ast


class Edits:
    """Parts of a source file and what comes in their place."""

    def __init__(self, source: bytes) -> None:
        self._source = source
        self._parts: list[tuple[int, int, bytes]] = []
        self._starts = [0]
        for line in source.splitlines(keepends=True):
            self._starts.append(self._starts[-1] + len(line))

    def span(self, node: ast.expr | ast.stmt) -> tuple[int, int]:
        """Return the bytes of a node."""
        return (
            self._starts[node.lineno - 1] + node.col_offset,
            self._starts[(node.end_lineno or node.lineno) - 1] + (node.end_col_offset or 0),
        )

    def replace(self, begin: int, end: int, text: str) -> None:
        """Put `text` in the place of these bytes."""
        self._parts.append((begin, end, text.encode()))

    def result(self) -> tuple[bytes, list[int]]:
        """Return the new text, and for each of its lines the number of the line that it comes from."""
        done, lines, at = b"", [1], 0
        for begin, end, text in sorted(self._parts):
            kept = self._source[at:begin]
            for _ in range(kept.count(b"\n")):
                lines.append(lines[-1] + 1)
            here = lines[-1]
            lines += [here] * text.count(b"\n")
            lines[-1] = here + self._source.count(b"\n", begin, end)
            done += kept + text
            at = end
        rest = self._source[at:]
        for _ in range(rest.count(b"\n")):
            lines.append(lines[-1] + 1)
        return done + rest, lines
