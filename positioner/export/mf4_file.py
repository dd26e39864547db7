"""An export as MDF 4 (ASAM): one channel group for each message, with units and comments. Shell.

The time of a channel group counts from the first frame of the log, whose instant is the start of the measurement.
"""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TYPE_CHECKING

import numpy as np

from positioner.errors import UsageError
from positioner.export.chunks import chunks

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    from positioner.export.log_rows import Group
    from positioner.export.signals import Value

_INSTALL = "asammdf is not installed: pip install 'sticking-valve-positioner[export]'"
_MICRO = 6
_DEFLATED = 2
"""asammdf's number for blocks that are transposed and deflated."""


def write_mf4(
    path: Path, groups: Sequence[Group], rows: Iterable[tuple[float, int, list[Value]]], begin_s: float
) -> None:
    """Write the rows to `path`; `begin_s` is the instant of the log's first frame.

    Raises:
        UsageError: asammdf is not installed.
    """
    try:
        from asammdf import MDF, Signal  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise UsageError(_INSTALL) from error
    with MDF(version="4.10") as mdf:
        mdf.header.start_time = datetime.fromtimestamp(begin_s, UTC)
        known: dict[int, int] = {}
        for chunk in chunks(groups, rows):
            for number, group in enumerate(groups):
                if not chunk.places[number].size:
                    continue
                time_s = np.round(chunk.time_s[chunk.places[number]] - begin_s, _MICRO)
                found = [chunk.column(number, index, signal) for index, signal in enumerate(group.signals)]
                lacking = [None if held is None else ~held for _, held in found]
                if number in known:
                    pairs = zip((values for values, _ in found), lacking, strict=True)
                    mdf.extend(known[number], [(time_s, None), *pairs])
                    continue
                signals = [
                    Signal(
                        samples=values,
                        timestamps=time_s,
                        name=signal.column,
                        unit=signal.unit,
                        comment=signal.meaning,
                        invalidation_bits=lacks,
                    )
                    for signal, (values, _), lacks in zip(group.signals, found, lacking, strict=True)
                ]
                message = group.message
                known[number] = mdf.append(
                    signals, acq_name=message.name, comment=message.comment or message.name, common_timebase=True
                )
        mdf.save(path, overwrite=True, compression=_DEFLATED)
