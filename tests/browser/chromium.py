"""A headless Chromium that is asked over a pipe: what a page requests, how long it loads, how it looks and prints."""

from __future__ import annotations

import base64
import json
import os
import shutil
import subprocess
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, BinaryIO

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

PROGRAMS = ("chromium", "chromium-browser", "google-chrome", "chrome-headless-shell")


def program() -> str | None:
    """Return the path of the browser on this machine."""
    return next(filter(None, map(shutil.which, PROGRAMS)), None)


@dataclass
class Browser:
    """One page of a browser; `events` are what it told since the last call of `open`."""

    commands: BinaryIO
    answers: BinaryIO
    session: str = ""
    number: int = 0
    events: list[dict[str, Any]] = field(default_factory=list)

    def ask(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Return the answer to a command of the DevTools protocol."""
        self.number += 1
        message = {"id": self.number, "method": method, "params": parameters}
        self.commands.write(
            json.dumps(message | ({"sessionId": self.session} if self.session else {})).encode() + b"\0"
        )
        self.commands.flush()
        while (told := self._message()).get("id") != self.number:
            self.events.append(told)
        assert "error" not in told, told
        answer: dict[str, Any] = told["result"]
        return answer

    def open(self, path: Path, width: int = 900) -> None:
        """Open a file, and wait until all of it is loaded."""
        self.visit(path.absolute().as_uri(), width)

    def visit(self, address: str, width: int = 900, height: int = 1200) -> None:
        """Open an address, and wait until all of the page is loaded."""
        self.events.clear()
        self.ask("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        self.ask("Page.navigate", url=address)
        while not any(each.get("method") == "Page.loadEventFired" for each in self.events):
            self.events.append(self._message())

    def evaluate(self, expression: str) -> Any:
        """Return the value of an expression in the page."""
        return self.ask("Runtime.evaluate", expression=expression, returnByValue=True)["result"]["value"]

    def requests(self) -> list[str]:
        """Return the addresses that the page asked for, its own one too."""
        asked = [each for each in self.events if each.get("method") == "Network.requestWillBeSent"]
        return [each["params"]["request"]["url"] for each in asked]

    def screenshot(self, path: Path) -> None:
        """Write the whole page, to its end, as PNG."""
        taken = self.ask("Page.captureScreenshot", captureBeyondViewport=True)
        path.write_bytes(base64.b64decode(taken["data"]))

    def pdf(self) -> bytes:
        """Return the page as it is printed on the paper that it asks for."""
        return base64.b64decode(self.ask("Page.printToPDF", preferCSSPageSize=True, printBackground=True)["data"])

    def _message(self) -> dict[str, Any]:
        taken = bytearray()
        while (byte := self.answers.read(1)) not in {b"\0", b""}:
            taken += byte
        assert taken, "the browser has ended"
        message: dict[str, Any] = json.loads(taken)
        return message


@contextmanager
def started(folder: Path) -> Iterator[Browser]:
    """Yield a page of a new browser, whose profile is in `folder`."""
    found = program()
    assert found is not None, "no browser: sudo apt-get install chromium"
    theirs_in, commands = os.pipe()
    answers, theirs_out = os.pipe()
    switches = ("--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run")
    background = (
        "--disable-background-networking",
        "--disable-component-update",
        "--disable-sync",
        "--no-default-browser-check",
    )

    def hand_over() -> None:
        """Give the browser its two ends as descriptors 3 and 4."""
        high_in, high_out = os.dup2(theirs_in, 20), os.dup2(theirs_out, 21)
        os.dup2(high_in, 3)
        os.dup2(high_out, 4)

    process = subprocess.Popen(
        [found, *switches, *background, f"--user-data-dir={folder}", "--remote-debugging-pipe", "about:blank"],
        close_fds=False,
        preexec_fn=hand_over,  # noqa: PLW1509 - no thread runs here
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    os.close(theirs_in)
    os.close(theirs_out)
    with os.fdopen(commands, "wb") as into, os.fdopen(answers, "rb") as out:
        browser = Browser(into, out)
        try:
            target = browser.ask("Target.createTarget", url="about:blank")["targetId"]
            browser.session = browser.ask("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
            for domain in ("Page", "Network", "Runtime"):
                browser.ask(f"{domain}.enable")
            yield browser
        finally:
            with suppress(AssertionError, OSError):
                browser.session = ""
                browser.ask("Browser.close")
            try:
                process.wait(10.0)
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, 9)
                process.wait()
