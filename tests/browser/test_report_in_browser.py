"""The report in a real browser: it asks for nothing, loads at once, and prints on two pages of A4.

`make test-browser` prints the load times, and leaves pictures and prints in `out/browser`.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from chromium import Browser, started
from pages import PAGES

from positioner.pictures.files import save
from positioner.pictures.panels import new_figure
from positioner.report.page import Page, Section, html
from positioner.report.picture import Picture

if TYPE_CHECKING:
    from collections.abc import Iterator

FOLDER = Path(__file__).resolve().parents[2] / "out" / "browser"
MOST_BYTES, MOST_SHEETS = 2_000_000, 2
LOAD_MS = "const t = performance.getEntriesByType('navigation')[0]; t.loadEventEnd"


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    FOLDER.mkdir(parents=True, exist_ok=True)
    with started(tmp_path_factory.mktemp("profile")) as found:
        yield found


@pytest.mark.parametrize("name", PAGES)
def test_it_asks_for_nothing_and_prints_on_two_sheets(browser: Browser, name: str) -> None:
    path = FOLDER / f"{name}.html"
    path.write_text(html(PAGES[name]()), encoding="utf-8")
    assert path.stat().st_size < MOST_BYTES
    browser.open(path)
    assert browser.requests() == [path.as_uri()]
    load_ms = browser.evaluate(LOAD_MS)
    browser.screenshot(path.with_suffix(".png"))
    printed = browser.pdf()
    path.with_suffix(".pdf").write_bytes(printed)
    sheets = len(re.findall(rb"/Type\s*/Page\b(?!s)", printed))
    sys.stdout.write(f"{name}: {path.stat().st_size / 1e3:.0f} kB, loaded in {load_ms:.0f} ms, {sheets} sheets\n")
    assert 1 <= sheets <= MOST_SHEETS
    assert browser.evaluate("document.documentElement.scrollWidth <= window.innerWidth")


@pytest.mark.parametrize("width", [360, 900])
def test_nothing_sticks_out_of_a_narrow_or_a_wide_window(browser: Browser, width: int) -> None:
    path = FOLDER / "narrow.html"
    path.write_text(html(next(iter(PAGES.values()))()), encoding="utf-8")
    browser.open(path, width)
    assert browser.evaluate("document.documentElement.scrollWidth") <= width


@pytest.mark.parametrize("width", [360, 1280])
def test_pictures_are_as_wide_as_the_window_and_ask_for_nothing(browser: Browser, width: int) -> None:
    figure = new_figure(3.0)
    figure.subplots().plot([0.0, 1.0], [1.0, 0.0], ".", rasterized=True)
    save(figure, FOLDER / "drawn.png")
    drawn = Picture("drawn", (FOLDER / "drawn.svg").read_text("utf-8"))
    path = FOLDER / "pictures.html"
    path.write_text(html(Page("t", "s", (Section("Pictures", pictures=(drawn, drawn)),), is_wide=True)), "utf-8")
    browser.open(path, width)
    assert [address for address in browser.requests() if not address.startswith("data:")] == [path.as_uri()]
    assert browser.evaluate("document.documentElement.scrollWidth") <= width
    shown = browser.evaluate("[...document.querySelectorAll('.picture')].map(e => e.getBoundingClientRect().width)")
    assert len(shown) == 2
    assert min(shown) > 0.85 * width
