"""The live page in a browser: its numbers move, its trend is drawn, and it asks nobody but its own server."""

from __future__ import annotations

import threading
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from chromium import Browser, started
from replay_helpers import scenario, write_bench_log

from positioner.config.reader import load_valves
from positioner.monitor.recorded import RecordedSource
from positioner.monitor.web import PageServer

if TYPE_CHECKING:
    from collections.abc import Iterator

FOLDER = Path(__file__).resolve().parents[2] / "out" / "browser"
INK = """(() => {
  const canvas = document.getElementById("trend");
  const data = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
  const wanted = [[0, 0x72, 0xb2], [0, 0, 0], [0x4b, 0x1d, 0x75]];
  return wanted.map(colour => {
    let count = 0;
    for (let i = 0; i < data.length; i += 4)
      if (data[i + 3] > 200 && colour.every((part, k) => Math.abs(data[i + k] - part) < 12)) count++;
    return count;
  });
})()"""
"""The pixels of the trend in the colours of position, setpoint and command."""


POSITION = 'document.getElementById("position").textContent'


@contextmanager
def page_of_a_log(folder: Path) -> Iterator[tuple[RecordedSource, PageServer]]:
    log, config = write_bench_log(folder, scenario(seconds=3.0))
    source = RecordedSource(load_valves(config), log)
    source.toggle()
    source.start()
    server = PageServer(source, 0)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield source, server
    finally:
        server.close()
        source.close()


def text(browser: Browser, name: str) -> str:
    return str(browser.evaluate(f"document.getElementById({name!r}).textContent"))


def until(browser: Browser, expression: str) -> Any:
    """Return the first true value of an expression in the page."""
    for _ in range(400):
        browser.ask("Runtime.evaluate", expression="new Promise(done => setTimeout(done, 50))", awaitPromise=True)
        if value := browser.evaluate(expression):
            return value
    raise AssertionError(expression)


def test_the_page_shows_moving_values_and_asks_nobody_else(tmp_path: Path) -> None:
    with page_of_a_log(tmp_path) as (source, server), started(tmp_path / "profile") as browser:
        browser.visit(server.address, height=760)
        until(browser, 'document.getElementById("time").textContent === "0.00 of 3.00 s, 1x"')
        browser.evaluate('(document.getElementById("play").click(), 1)')
        first = until(browser, f'{POSITION} !== "-" && {POSITION}')
        until(browser, f"{POSITION} !== {first!r}")
        until(browser, 'document.getElementById("time").textContent.startsWith("3.00 of 3.00 s")')
        assert text(browser, "setpoint") == "80.000 mm"
        assert text(browser, "state") == "ACTIVE: controls the valve"
        assert text(browser, "health") == "NE 107: good"
        assert text(browser, "current").endswith(" mA")
        assert "commands 1000.0/s" in text(browser, "rates")
        assert "lost 0, late 0" in text(browser, "seen")
        assert all(pixels > 100 for pixels in browser.evaluate(INK))
        FOLDER.mkdir(parents=True, exist_ok=True)
        browser.screenshot(FOLDER / "monitor.png")
        assert browser.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
        # the page plays the log again, from the beginning
        browser.evaluate('(document.getElementById("speed").value = "0.1", 1)')
        browser.evaluate('(document.getElementById("speed").onchange(), 1)')
        browser.evaluate('(document.getElementById("play").click(), 1)')
        until(browser, 'document.getElementById("time").textContent.startsWith("0.")')
        assert source.progress.speed == 0.1
        asked = browser.requests()
        assert all(address.startswith((server.address, "data:")) for address in asked), asked
        # a page that has lost its monitor says so
        server.stopping.set()
        until(browser, 'document.getElementById("line").textContent.includes("waiting")')


def test_two_browsers_see_the_same_on_a_small_screen_too(tmp_path: Path) -> None:
    with page_of_a_log(tmp_path) as (_, server), started(tmp_path / "one") as one, started(tmp_path / "two") as two:
        for browser, width in ((one, 360), (two, 1600)):
            browser.visit(server.address, width)
        one.evaluate('(document.getElementById("play").click(), 1)')
        for browser in (one, two):
            until(browser, 'document.getElementById("time").textContent.startsWith("3.00 of 3.00 s")')
            assert browser.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
            browser.screenshot(tmp_path / f"{browser is one}.png")
        assert text(one, "position") == text(two, "position")
