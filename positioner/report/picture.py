"""A picture as SVG inside a page: without its own prolog, size and style, which would reach beyond it. Pure."""

from __future__ import annotations

import re
from dataclasses import dataclass

from markupsafe import Markup, escape

_HEAD = re.compile(r"<svg\b[^>]*>")
_VIEW = re.compile(r'viewBox="([^"]*)"')
_METADATA = re.compile(r"<metadata>.*?</metadata>", re.DOTALL)
_STYLE = re.compile(r"<style\b[^>]*>.*?</style>", re.DOTALL)
_EMPTY = re.compile(r"<defs>\s*</defs>")
_NAME = re.compile(r' id="([^"]*)"')
_USED = re.compile(r'(?:url\(#|href="#)([^")]+)')
_LINES = "stroke-linejoin:round;stroke-linecap:butt"
"""What the style sheet of such an SVG says of everything."""


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture with its title; `source` is an SVG document, as a file holds it."""

    title: str
    source: str

    def svg(self) -> Markup:
        """Return the SVG element, as wide as its place.

        Names that nothing refers to are left out: two pictures on a page have the same ones.
        """
        found = _HEAD.search(self.source)
        view = _VIEW.search(found[0]) if found else None
        if found is None or view is None:
            raise ValueError(f"{self.title}: is no SVG picture")
        body = self.source[found.end() :]
        for part in (_METADATA, _STYLE, _EMPTY):
            body = part.sub("", body)
        used = set(_USED.findall(body))
        body = _NAME.sub(lambda name: name[0] if name[1] in used else "", body)
        space = 'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'
        about = f'viewBox="{escape(view[1])}" role="img" aria-label="{escape(self.title)}" style="{_LINES}"'
        return Markup(f'<svg class="picture" {space} {about}>{body}')  # noqa: S704 - a picture of our own
