"""The stretch of a record that a picture of a diagnosis shows. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from positioner.diagnostics.finding import Finding

_PERIODS = 12.0
_SLIPS = 12


def shown_part(finding: Finding, count: int) -> tuple[int, int]:
    """Return the samples to show: some periods or slips in the middle of the record."""
    length = float(count)
    if finding.direct and len(finding.direct.slips) > _SLIPS:
        slips = finding.direct.slips
        middle = len(slips) // 2
        begin = slips[max(middle - _SLIPS // 2, 0)].before.begin
        return begin, min(slips[min(middle + _SLIPS // 2, len(slips) - 1)].after.end, count)
    if finding.indirect:
        length = min(length, max(_PERIODS * finding.indirect.oscillation.period, 200.0))
    begin = max(int(0.5 * (count - length)), 0)
    return begin, min(begin + math.ceil(length), count)
