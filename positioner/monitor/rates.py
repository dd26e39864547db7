"""How many messages of each kind come in a second, over the last two seconds. Pure."""

from __future__ import annotations

from collections import deque

_SLOT_NS = 100_000_000
_SLOTS = 20
_SLOTS_PER_S = 10


class Rate:
    """The messages of one kind, counted in slots of 0.1 s."""

    def __init__(self) -> None:
        """Begin with none."""
        self._slots: deque[tuple[int, int]] = deque(maxlen=_SLOTS + 1)
        self._first: int | None = None

    def add(self, now_ns: int) -> None:
        """Count a message."""
        slot = now_ns // _SLOT_NS
        if self._first is None:
            self._first = slot
        if self._slots and self._slots[-1][0] == slot:
            self._slots[-1] = (slot, self._slots[-1][1] + 1)
        else:
            self._slots.append((slot, 1))

    def per_s(self, now_ns: int) -> float:
        """Return the messages in a second, in the full slots of the last two; 0 where none is full yet."""
        now = now_ns // _SLOT_NS
        if self._first is None:
            return 0.0
        begin = max(now - _SLOTS, self._first + 1)
        if begin >= now:
            return 0.0
        count = 0
        for slot, messages in self._slots:
            if begin <= slot < now:
                count += messages
        return count * _SLOTS_PER_S / (now - begin)

    def copy(self) -> Rate:
        """Return a rate that goes on by itself."""
        new = Rate()
        new._slots, new._first = self._slots.copy(), self._first
        return new
