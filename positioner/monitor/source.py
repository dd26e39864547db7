"""Where a view gets its valves from: a thread that fills the models, and what a view may ask and do meanwhile. Shell.

A view that is slow, or a browser, delays the thread only for the time of a copy.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import TYPE_CHECKING

from positioner.monitor.model import ValveModel

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from positioner.config.schema import Configuration
    from positioner.monitor.kept_table import TableView
    from positioner.monitor.trend import Bin
    from positioner.monitor.view import View


NICENESS = 5
"""A view yields the processor to the positioner."""


@dataclass(frozen=True, slots=True)
class Progress:
    """Where a log is: the instant that is shown and its end in s, how fast it plays, and whether it does."""

    time_s: float
    end_s: float
    speed: float
    playing: bool


@dataclass(frozen=True, slots=True)
class Snapshot:
    """One valve now: what to show, the newest bins of its trend, the instant, and its stiction table where known."""

    view: View
    bins: tuple[Bin, ...]
    now_ns: int
    table: TableView | None


class Source:
    """The valves of a bus or of a log.

    line: what is with the bus or the log, in words; in_trouble: a person should look at it. failure: the error that
    has ended the thread.
    """

    def __init__(self, configurations: Sequence[Configuration]) -> None:
        """Begin with nothing received."""
        self.valves = tuple(configuration.valve.id for configuration in configurations)
        self.models: Mapping[str, ValveModel] = {each.valve.id: ValveModel(each) for each in configurations}
        self.tables: dict[str, TableView] = {}
        self.line, self.in_trouble = "", False
        self.failure: Exception | None = None
        self._lock = threading.Lock()
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="monitor", daemon=True)

    def start(self) -> None:
        """Begin to fill the models."""
        self._thread.start()

    def close(self) -> None:
        """End the thread."""
        self._stopping.set()
        if self._thread.ident is not None:
            self._thread.join()

    def snapshot(self, valve: str, since: int = -1) -> Snapshot:
        """Return the valve now, with the bins of its trend after the bin `since`."""
        with self._lock:
            model, now_ns = self.models[valve], self.now_ns()
            return Snapshot(model.view(now_ns), model.trend.since(since), now_ns, self.tables.get(valve))

    def now_ns(self) -> int:
        """Return the instant that is shown."""
        raise NotImplementedError

    @property
    def progress(self) -> Progress | None:
        """Where the log is, None on a bus."""
        return None

    def toggle(self) -> None:
        """Stop a log, or let it play."""

    def seek(self, time_s: float) -> None:
        """Go to an instant of a log."""

    def play_at(self, speed: float) -> None:
        """Play a log so many times as fast as it was."""

    def _round(self) -> None:
        """Wait a little, and take in what has come."""
        raise NotImplementedError

    def _run(self) -> None:
        try:
            while not self._stopping.is_set():
                self._round()
        except Exception as error:  # noqa: BLE001 - the view ends with it, in the main thread
            self.failure = error
