"""The built site, which `make site` leaves in out/site: it asks the network for nothing, and its search works."""

from __future__ import annotations

import re
import time
from html.parser import HTMLParser
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from chromium import Browser, started

if TYPE_CHECKING:
    from collections.abc import Iterator

SITE = Path(__file__).resolve().parents[2] / "out" / "site"
PAGES = sorted(path for path in SITE.rglob("*.html") if path.name != "404.html")
LOADING = {"script": "src", "img": "src", "iframe": "src", "source": "src", "object": "data", "embed": "src"}
LOADING_LINKS = {"stylesheet", "icon", "preload", "prefetch", "preconnect", "dns-prefetch", "manifest", "modulepreload"}
TYPE_INTO_SEARCH = """(words => {
    const field = document.querySelector("[data-md-component=search-query]");
    field.focus();
    field.value = words;
    field.dispatchEvent(new KeyboardEvent("keyup", {bubbles: true}));
    return words;
})"""
FOUND = "document.querySelector('.md-search-result__list')?.innerText ?? ''"
LONGEST_S = 20.0


class Loaded(HTMLParser):
    """What a browser loads for a page without being asked: scripts, styles, pictures, frames."""

    def __init__(self) -> None:
        super().__init__()
        self.addresses: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        if tag in LOADING and (address := given.get(LOADING[tag])):
            self.addresses.append(address)
        if tag == "link" and LOADING_LINKS & set((given.get("rel") or "").split()):
            self.addresses.append(given["href"] or "")


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with started(tmp_path_factory.mktemp("profile")) as found:
        yield found


def test_the_site_is_built_and_has_the_readme_as_its_first_page() -> None:
    assert len(PAGES) > 20
    assert "Quick start" in (SITE / "index.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(SITE)))
def test_a_page_loads_only_files_that_are_in_the_site(page: Path) -> None:
    loaded = Loaded()
    loaded.feed(page.read_text(encoding="utf-8"))
    assert len(loaded.addresses) > 3
    for address in loaded.addresses:
        assert not re.match(r"\w+:|//", address) or address.startswith("data:image/"), address
        if not address.startswith("data:"):
            assert (page.parent / address.partition("?")[0].partition("#")[0]).is_file(), address


def test_no_style_sheet_loads_anything_from_elsewhere() -> None:
    sheets = list(SITE.rglob("*.css"))
    assert len(sheets) > 2
    for sheet in sheets:
        text = sheet.read_text(encoding="utf-8")
        assert "@import" not in text
        assert not re.findall(r"url\(\s*['\"]?(?:\w+:)?//", text), sheet


def test_a_browser_that_opens_the_site_from_a_disk_asks_for_its_files_alone_and_finds_a_word(browser: Browser) -> None:
    browser.open(SITE / "index.html")
    deadline_s = time.monotonic() + LONGEST_S
    while "What stiction is" not in browser.evaluate(FOUND):  # a section that has the two words
        assert time.monotonic() < deadline_s, browser.evaluate(FOUND)
        browser.evaluate(f"{TYPE_INTO_SEARCH}('breaks away')")
        time.sleep(0.2)
    asked = [address for address in browser.requests() if not address.startswith("data:")]
    assert len(asked) > 5
    assert all(address.startswith(f"{SITE.as_uri()}/") for address in asked), asked
