"""`bus.log` of a bench: recorded frames in candump's format. Shell."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.bus import can

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from positioner.wire.messages import CanFrame

LOG_CHANNEL = "vcan0"
"""The channel in the log, whatever bus was recorded: canplayer plays it there by default."""


def write_frames(path: Path, frames: Sequence[tuple[float, int, CanFrame]], *, by_rank: bool) -> None:
    """Write frames, each with its instant in s and its rank, in the order of the instants, and then `by_rank`."""
    order = sorted(range(len(frames)), key=lambda index: frames[index][: 2 if by_rank else 1])
    with can.CanutilsLogWriter(path, channel=LOG_CHANNEL) as log:
        for index in order:
            stamp_s, _, frame = frames[index]
            log.on_message_received(
                can.Message(
                    timestamp=stamp_s,
                    arbitration_id=frame.arbitration_id,
                    data=frame.data,
                    is_extended_id=frame.is_extended,
                    is_rx=True,
                    channel=LOG_CHANNEL,
                )
            )
