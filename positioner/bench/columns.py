"""One field of many frames at once, as an array: the same values as of frames that are decoded one by one. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from positioner.wire.formats import FrameFormat
    from positioner.wire.messages import CanFrame


def column(form: FrameFormat, name: str, frames: Sequence[CanFrame]) -> NDArray[np.float64]:
    """Return the values of the number `name` in `frames` of one kind, which nobody damaged; shape (n,)."""
    if form.data_id is None:  # a user's frame may have any length and any order of its bytes
        return np.array([getattr(form.decode(frame)[0], name) for frame in frames], np.float64)
    field = form.placed(name)
    words = np.frombuffer(b"".join([frame.data for frame in frames]), "<u8")
    raw = ((words >> field.shift & field.mask).astype(np.int64) ^ field.sign) - field.sign
    return raw.astype(np.float64) * np.float64(field.si_per_bit) + np.float64(field.si_offset)
