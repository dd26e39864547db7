"""The valves of a log, which plays as a bus would bring them. Shell."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from positioner.inputs.plain_file import MOST_MIB
from positioner.monitor.packed import PackedFrames
from positioner.monitor.playback import FASTEST, SLOWEST, Playback
from positioner.monitor.source import Progress, Source
from positioner.replay.log import LogError, read_log

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from positioner.config.schema import Configuration
    from positioner.replay.log import LogFrame

_ROUND_S = 0.02
_NS = 1_000_000_000


class RecordedSource(Source):
    """The valves of a configuration in a log."""

    def __init__(self, configurations: Sequence[Configuration], path: Path, most_mib: int = MOST_MIB) -> None:
        """Read the log.

        Raises:
            LogError: it cannot be read, or holds no frame of a valve.
        """
        super().__init__(configurations)
        frames = PackedFrames()
        wanted = {identifier for model in self.models.values() for identifier in model.identifiers}

        def keep(logged: LogFrame) -> None:
            if logged.frame.is_error or logged.frame.identifier in wanted:
                frames.add(logged.frame, logged.time_ns)

        log = read_log(path, keep, most_mib)
        if not len(frames):
            names = ", ".join(self.valves)
            raise LogError(f"{path}: holds no frame of {names}: is it the log of another valve, or of other [wire]?")
        self._playback = Playback(frames, self.models)
        self.models = self._playback.models
        self.line = f"{path.name}{f' ({log.cut})' if log.cut else ''}"
        self.in_trouble = bool(log.cut)
        self._before_s = time.monotonic()

    def now_ns(self) -> int:
        """Return the instant of the log that is shown."""
        return self._playback.time_ns

    @property
    def progress(self) -> Progress:
        """Where the log is."""
        playback = self._playback
        return Progress(playback.time_ns / _NS, playback.end_ns / _NS, playback.speed, playback.playing)

    def toggle(self) -> None:
        """Stop the log, or let it play."""
        with self._lock:
            self._playback.toggle()

    def seek(self, time_s: float) -> None:
        """Go to an instant of the log."""
        with self._lock:
            self._playback.seek(round(min(time_s, self._playback.end_ns / _NS) * _NS))
            self.models = self._playback.models

    def play_at(self, speed: float) -> None:
        """Play the log so many times as fast as it was, within what makes sense."""
        self._playback.speed = min(max(speed, SLOWEST), FASTEST)

    def _round(self) -> None:
        now_s = time.monotonic()
        with self._lock:
            reached = self._playback.advance(now_s - self._before_s)
            self.models = self._playback.models
        self._before_s = now_s
        self._stopping.wait(_ROUND_S if reached else 0.0)
