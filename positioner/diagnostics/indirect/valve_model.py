"""He's two-parameter model of a sticking valve, for many pairs of parameters at once. Pure.

Q. P. He and others (2007): the force that has built up since the last slip moves the stem once it exceeds f_s; then f_d
is left. S = f_s + f_d, J = f_s - f_d.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from positioner.diagnostics.indirect.loop import Array as _Array

Array = NDArray[np.float64]


def stem_positions(op: _Array, stick: Array, jump: Array) -> Array:
    """Return the stem for each command and pair (S, J), as (sample, pair), in the unit of the command."""
    static, sliding = 0.5 * (stick + jump), 0.5 * (stick - jump)
    stem = np.full(stick.size, op[0])
    found = np.empty((op.size, stick.size))
    for number, command in enumerate(op.tolist()):
        pull = command - stem
        slips = np.abs(pull) > static
        stem = np.where(slips, command - np.sign(pull) * sliding, stem)
        found[number] = stem
    return found
