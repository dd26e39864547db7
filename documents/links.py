"""Links between the pages of the repository, as the site has them. Pure.

In the repository a page links to files, wherever they are. On the site every page of `docs/` and every page beside the
README is in one folder, and other files that a page links to are in `files/`.
"""

from __future__ import annotations

import posixpath
import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

FILES = "files/"
"""Where the site has copies of files that are no pages, such as examples."""
_FENCE = re.compile(r"(^```.*?^```$)", re.DOTALL | re.MULTILINE)
_LINK = re.compile(r"(\]\()([^)\s#]+)((?:#[^)\s]*)?\))")


def place_of(path: str) -> str:
    """Return where the site has a file of the repository, whose `path` is seen from its root."""
    if path == "README.md":
        return "index.md"
    if path.startswith("docs/"):
        return path.removeprefix("docs/")
    if path.endswith(".md") and "/" not in path:
        return path
    if path.startswith("examples/") and path.endswith(".ipynb"):
        return f"notebooks/{path.removeprefix('examples/').removesuffix('.ipynb')}.md"
    return FILES + path


def linked(text: str, path: str, exists: Callable[[str], bool]) -> set[str]:
    """Return the files of the repository to which the page at `path` links."""
    found: set[str] = set()
    _each_link(text, path, exists, found.add)
    return found


def rewritten(text: str, path: str, exists: Callable[[str], bool]) -> str:
    """Return the page at `path` with links that hold on the site; what leads to no file is left for its check."""
    return _each_link(text, path, exists, lambda _: None)


def _each_link(text: str, path: str, exists: Callable[[str], bool], seen: Callable[[str], None]) -> str:
    folder, own = posixpath.dirname(path), posixpath.dirname(place_of(path))

    def replaced(found: re.Match[str]) -> str:
        target = posixpath.normpath(posixpath.join(folder, found[2]))
        if re.match(r"\w+:", found[2]) or not exists(target):
            return found[0]
        seen(target)
        return found[1] + posixpath.relpath(place_of(target), own or ".") + found[3]

    return "".join(part if part.startswith("```") else _LINK.sub(replaced, part) for part in _FENCE.split(text))
