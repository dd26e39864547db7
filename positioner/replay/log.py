"""A recorded bus as frames: candump, ASC, BLF, CSV, or whatever else python-can reads. Shell."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import count
from typing import TYPE_CHECKING

import can
from tqdm import tqdm

from positioner.errors import ExitCode, PositionerError
from positioner.wire.messages import CanFrame

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

_NS = 1_000_000_000
_BLF_HEADER_BYTES = 144
_LATEST_S = 1e11
"""No clock of a logger is past the year 5000; NaN is no smaller either."""


class LogError(PositionerError):
    """A log that cannot be replayed: unreadable, or without what a replay needs."""

    exit_code = ExitCode.IO


@dataclass(frozen=True, slots=True)
class LogFrame:
    """One frame of a log: its number (from 1), its time in ns since the first frame, and whether the logger sent it."""

    number: int
    time_ns: int
    frame: CanFrame
    sent: bool


@dataclass(frozen=True, slots=True)
class BusLog:
    """A log: its frames in order, the time stamp of the first in s, and where and why it ends early, if it does."""

    source: str
    frames: tuple[LogFrame, ...]
    begin_s: float
    cut: str = ""

    def instant_s(self, frame: LogFrame) -> float:
        """Return the time stamp that `frame` has in the file, in s."""
        return self.begin_s + frame.time_ns / _NS


def read_log(path: Path) -> BusLog:
    """Return the log in `path`; of a log that is cut or damaged on the way, what stands before.

    Raises:
        LogError: it cannot be read at all, or holds no frame.
    """
    frames: list[LogFrame] = []
    begin_s, cut = 0.0, ""
    try:
        with path.open("rb") as file:  # python-can's own complaint would name neither the file nor the reason
            _check_head(path, file.read(_BLF_HEADER_BYTES))
        reader = can.LogReader(path)
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror}") from error
    except LogError:
        raise
    except Exception as error:
        told = str(error) or type(error).__name__
        raise LogError(f"{path}: cannot be read: {told}; known formats: {_formats()}") from error
    with reader, tqdm(desc="reading", unit=" frames", delay=1.0, leave=False, disable=None) as bar:
        messages: Iterator[can.Message] = iter(reader)
        for number in count(1):
            try:
                message = next(messages, None)
                _check_stamp(message)
            except Exception as error:  # noqa: BLE001 - the same
                cut = f"what follows frame {len(frames)} cannot be read ({type(error).__name__}: {error})"
                break
            if message is None:
                break
            begin_s = begin_s if frames else message.timestamp
            # to the microsecond: stamps that are large floating-point numbers carry no more
            time_ns = round((message.timestamp - begin_s) * 1e6) * 1000
            bar.update()
            frames.append(LogFrame(number, time_ns, _frame(message), sent=not message.is_rx))
        promised = getattr(reader, "object_count", len(frames))
    if not cut and _ends_within_a_line(path):
        frames = frames[:-1]
        cut = f"the line behind frame {len(frames)} is not complete"
    elif not cut and promised > len(frames):
        cut = f"frame {len(frames)} is the last of {promised}"
    if not frames:
        raise LogError(f"{path}: holds no frame{f': {cut}' if cut else ''}; known formats: {_formats()}")
    return BusLog(str(path), tuple(frames), begin_s, cut)


def _check_head(path: Path, head: bytes) -> None:
    """Refuse what cannot be BLF under the name of one: python-can would leave the file open."""
    if path.suffix.lower() == ".blf" and not (head.startswith(b"LOGG") and len(head) == _BLF_HEADER_BYTES):
        raise LogError(f"{path}: cannot be read: it is no BLF file")


def _check_stamp(message: can.Message | None) -> None:
    if message is not None and not abs(message.timestamp) <= _LATEST_S:
        raise ValueError(f"{message.timestamp:g} s is no time stamp")


def _frame(message: can.Message) -> CanFrame:
    return CanFrame(
        message.arbitration_id,
        bytes(message.data),
        message.is_extended_id,
        message.is_error_frame,
        message.is_remote_frame,
    )


def _ends_within_a_line(path: Path) -> bool:
    """Return whether a text log ends without the end of its last line: that line may lack some bytes."""
    if path.suffix.lower() not in {".log", ".asc", ".csv", ".trc"}:
        return False
    with path.open("rb") as file:
        if file.seek(0, 2) == 0:
            return False
        file.seek(-1, 2)
        return file.read(1) != b"\n"


def _formats() -> str:
    return ", ".join(sorted(can.io.player.MESSAGE_READERS))
