"""A log that plays: its frames go to the models as its time passes, forth and back, at any speed. Pure.

Going back begins at a copy of the models from shortly before, so the numbers are those of one pass.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

    from positioner.monitor.model import ValveModel
    from positioner.monitor.packed import PackedFrames

FRAMES_AT_ONCE = 2000
"""Frames of one `advance`: so many take less than a tenth of a second."""
_COPY_EVERY_NS = 5_000_000_000
_NS = 1_000_000_000
SLOWEST, FASTEST = 0.01, 100.0


class Playback:
    """The frames, and how far they are shown: `time_ns`. `models` change when it goes back."""

    def __init__(self, frames: PackedFrames, models: Mapping[str, ValveModel]) -> None:
        """Begin before the first frame, playing."""
        self._frames = frames
        self._begin = {name: model.copy() for name, model in models.items()}
        self._copies: dict[int, tuple[int, dict[str, ValveModel]]] = {}
        self.end_ns = frames.times_ns[-1]
        self.playing, self.speed = True, 1.0
        self.models: dict[str, ValveModel] = {}
        self.time_ns = self._goal_ns = self._next = 0
        self._restart()

    def advance(self, elapsed_s: float) -> bool:
        """Let time pass; return whether the models show the present instant, or there are still frames to come."""
        if self.playing and self._goal_ns == self.time_ns:
            self._goal_ns = min(self._goal_ns + round(elapsed_s * self.speed * _NS), self.end_ns)
        frames, last = self._frames, len(self._frames)
        for _ in range(FRAMES_AT_ONCE):
            if self._next >= last or frames.times_ns[self._next] > self._goal_ns:
                self.time_ns = self._goal_ns
                break
            self._take(self._next)
            self._next += 1
        self.playing = self.playing and self.time_ns < self.end_ns
        return self.time_ns == self._goal_ns

    def seek(self, to_ns: int) -> None:
        """Go to an instant; `advance` then takes the frames up to there."""
        to_ns = min(max(to_ns, 0), self.end_ns)
        if to_ns < self.time_ns:
            number = max((each for each in self._copies if each * _COPY_EVERY_NS <= to_ns), default=None)
            if number is None:
                self._restart()
            else:
                self._next, copies = self._copies[number]
                self.models = {name: model.copy() for name, model in copies.items()}
                self.time_ns = number * _COPY_EVERY_NS
        self._goal_ns = to_ns

    def toggle(self) -> None:
        """Stop, or play; from the end, from the beginning."""
        if not self.playing and self.time_ns >= self.end_ns:
            self.seek(0)
        self.playing = not self.playing

    def _restart(self) -> None:
        self.models = {name: model.copy() for name, model in self._begin.items()}
        self.time_ns = self._goal_ns = self._next = 0

    def _take(self, number: int) -> None:
        time_ns = self._frames.times_ns[number]
        copy = time_ns // _COPY_EVERY_NS
        is_first = number > 0 and self._frames.times_ns[number - 1] // _COPY_EVERY_NS < copy
        if is_first and copy not in self._copies:
            self._copies[copy] = number, {name: model.copy() for name, model in self.models.items()}
        frame = self._frames.frame(number)
        for model in self.models.values():
            if frame.is_error or frame.identifier in model.identifiers:
                model.add(frame, time_ns)
        self.time_ns = max(self.time_ns, time_ns)
