"""The last minute of a valve in bins of 10 ms, each with its lowest and highest value: a slip is that short. Pure."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from typing import NamedTuple

BIN_NS = 10_000_000
KEPT_S = 60.0
_BINS_KEPT = round(KEPT_S * 1e9) // BIN_NS


class Bin(NamedTuple):
    """What came within 10 ms; `number` counts bins from instant 0. None for what did not come."""

    number: int
    readings: int
    position_low_m: float | None
    position_high_m: float | None
    position_mean_m: float | None
    setpoint_m: float | None
    current_low_ma: float | None
    current_high_ma: float | None


@dataclass(slots=True)
class _Range:
    """The values of one quantity in the bin that is filled at present."""

    low: float | None = None
    high: float | None = None
    total: float = 0.0
    count: int = 0

    def add(self, value: float) -> None:
        self.low = value if self.low is None or value < self.low else self.low
        self.high = value if self.high is None or value > self.high else self.high
        self.total += value
        self.count += 1

    @property
    def mean(self) -> float | None:
        return self.total / self.count if self.count else None


class Trend:
    """The bins that are full, and the one that is being filled."""

    def __init__(self) -> None:
        """Begin with nothing."""
        self._setpoint_m: float | None = None
        self._full: deque[Bin] = deque(maxlen=_BINS_KEPT)
        self._begin(0)

    def position(self, position_m: float, now_ns: int) -> None:
        """Add a reading."""
        self._reach(now_ns // BIN_NS)
        self._position.add(position_m)

    def current(self, current_ma: float, now_ns: int) -> None:
        """Add a command."""
        self._reach(now_ns // BIN_NS)
        self._current.add(current_ma)

    def setpoint(self, setpoint_m: float, now_ns: int) -> None:
        """Add a setpoint."""
        self._reach(now_ns // BIN_NS)
        self._setpoint_m = setpoint_m

    def since(self, number: int) -> tuple[Bin, ...]:
        """Return the bins after the bin `number`, oldest first; the newest one may still change."""
        now = self._now()
        newer = [] if now is None or now.number <= number else [now]
        for each in reversed(self._full):
            if each.number <= number:
                break
            newer.append(each)
        return tuple(reversed(newer))

    def mean_position_m(self, bins: int, now_ns: int) -> float | None:
        """Return the mean in m of the readings in the newest `bins` bins, None where none came."""
        total, count = 0.0, 0
        since = now_ns // BIN_NS - bins
        for each in self.since(since):
            if each.position_mean_m is not None:
                total += each.position_mean_m * each.readings
                count += each.readings
        return total / count if count else None

    def copy(self) -> Trend:
        """Return a trend that goes on by itself."""
        new = Trend()
        new._full = self._full.copy()
        new._number, new._setpoint_m = self._number, self._setpoint_m
        new._position, new._current = replace(self._position), replace(self._current)
        return new

    def _reach(self, number: int) -> None:
        if number == self._number:
            return
        now = self._now()
        if now is not None:
            self._full.append(now)
        self._begin(number)

    def _begin(self, number: int) -> None:
        self._number = number
        self._position, self._current = _Range(), _Range()
        self._setpoint_m = None

    def _now(self) -> Bin | None:
        position, current = self._position, self._current
        if not position.count and not current.count and self._setpoint_m is None:
            return None
        place = (position.low, position.high, position.mean)
        return Bin(self._number, position.count, *place, self._setpoint_m, current.low, current.high)
