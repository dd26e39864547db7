"""What a command shows in a terminal of some width, in a pipe, in ASCII."""

from __future__ import annotations

import io
import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING

import pytest

from positioner.cli.tables import show

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from positioner.report.text import Block

PLAIN = {"TERM": "dumb"}


class Screen(io.TextIOWrapper):
    """A stream that says whether it is a terminal."""

    def __init__(self, encoding: str = "utf-8", *, is_terminal: bool) -> None:
        super().__init__(io.BytesIO(), encoding=encoding, errors="strict", write_through=True)
        self._is_terminal = is_terminal

    def isatty(self) -> bool:
        return self._is_terminal

    @property
    def text(self) -> str:
        assert isinstance(self.buffer, io.BytesIO)
        return self.buffer.getvalue().decode(self.encoding)


def shown(
    blocks: Iterable[Block],
    width: int | None = None,
    *,
    encoding: str = "utf-8",
    as_markdown: bool = False,
    environment: Mapping[str, str] = {},
) -> str:
    """Return what is shown in a terminal of this width, or in a pipe."""
    with screen(width, encoding=encoding, environment=environment) as stream:
        show(blocks, as_markdown=as_markdown)
    return stream.text


@contextmanager
def screen(width: int | None, *, encoding: str = "utf-8", environment: Mapping[str, str] = PLAIN) -> Iterator[Screen]:
    """Yield the standard output of a command in a terminal of this width, or in a pipe."""
    stream = Screen(encoding, is_terminal=width is not None)
    with pytest.MonkeyPatch.context() as patch:
        for name in ("NO_COLOR", "FORCE_COLOR", "COLORTERM", "TTY_COMPATIBLE", "TTY_INTERACTIVE"):
            patch.delenv(name, raising=False)
        patch.setenv("TERM", "xterm-256color")
        for name, value in environment.items():
            patch.setenv(name, value)
        patch.setenv("COLUMNS", str(width or 80))
        patch.setattr(sys, "stdout", stream)
        yield stream
