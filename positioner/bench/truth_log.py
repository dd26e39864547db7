"""`bus.log` of a real-time bench: the positioner's own record, and truth frames that only the bench received. Shell.

The record can be replayed: it holds the frames in the order and at the instants at which they were handled. The truth
frames are merged into it by time; both use the machine's monotonic clock.
"""

from __future__ import annotations

import heapq
from typing import TYPE_CHECKING

from positioner.runtime.record import CHANNEL
from positioner.wire.messages import PlantTruth

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from positioner.bench.recording import Recording


def add_truth(path: Path, recording: Recording) -> None:
    """Merge the truth frames of `recording` into the record in `path`; the first frame then has the time zero."""
    record = path.read_text(encoding="ascii").splitlines()
    own = [(_stamp_us(line), line.split(" ", maxsplit=1)[1]) for line in record]
    merged = list(heapq.merge(own, _truth(recording), key=lambda stamped: stamped[0]))
    begin_us = merged[0][0] if merged else 0
    with path.open("w", encoding="ascii") as file:
        for stamp_us, rest in merged:
            seconds, rest_us = divmod(stamp_us - begin_us, 1_000_000)
            file.write(f"({seconds}.{rest_us:06d}) {rest}\n")


def _stamp_us(line: str) -> int:
    seconds, microseconds = line[1 : line.index(")")].split(".")
    return int(seconds) * 1_000_000 + int(microseconds)


def _truth(recording: Recording) -> Iterator[tuple[int, str]]:
    identifier, _ = recording.codec.identifier(PlantTruth)
    for stamp_s, _, frame in recording.frames:
        if frame.arbitration_id == identifier and not frame.is_extended:
            stamp_us = (recording.begin_ns + round(stamp_s * 1e9)) // 1000
            yield stamp_us, f"{CHANNEL} {identifier:03X}#{frame.data.hex().upper()} R"
