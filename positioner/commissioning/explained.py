"""Which parts of its record a fitted valve explains: the residuals by what the stem did, and by direction. Pure.

Between a reading and the fitted valve there are the noise, the least error of the model, and what the model does not
know. A part of the record is explained while the root mean square of its residuals is at most
    2·√(σ² + (0.05·F_c/K)²).
σ is that of a reading, with the least error of the model (`windows`). On valves that obey the model the mean square
over σ² is 0.02 to 1.4 in each part, at 0.05 % and at 2 % of noise; n readings let it scatter by √(2/n), and n is at
least 20. So 2 σ means another model, and no chance. A stem that stands off by r shows a force of K·r that the model
does not know: a twentieth of F_c is what moves of a good valve scatter by (`health/friction_trend`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from positioner.commissioning.observed import Observed

    Array = NDArray[np.float64]

_ALLOWED, _MOST = 0.05, 2.0
_BEGUN, _DONE = 0.01, 0.99
"""Parts of its way between which a stem slips."""
_FEWEST = 20
_POINTS = 60
STROKES, BREAKAWAYS, STEPS = "strokes", "breakaways", "steps"
BEFORE, SLIPPING, AFTER = "at rest before the slip", "in the slip", "after the slip"


@dataclass(frozen=True, slots=True)
class Part:
    """The residuals of one kind of stretch in one phase and direction.

    phase: empty for strokes, which slide. off_m: their root mean square; most_m: the most that counts as explained.
    curve: their mean in m over the place in m for strokes, else over the time in s since the slip was seen.
    """

    kind: str
    phase: str
    direction: float
    off_m: float
    most_m: float
    curve: tuple[tuple[float, float], ...] = ()

    @property
    def explained(self) -> bool:
        """Whether the fitted valve explains these readings."""
        return self.off_m <= self.most_m

    def __str__(self) -> str:
        """What the stem did, for a person."""
        return ", ".join(each for each in (self.kind, self.phase, self._way) if each)

    @property
    def _way(self) -> str:
        return "opening" if self.direction > 0.0 else "closing"

    def as_json(self) -> dict[str, Any]:
        """Return the part for a program, in SI units."""
        return {
            "kind": self.kind,
            "phase": self.phase,
            "direction": self._way,
            "off_m": self.off_m,
            "most_m": self.most_m,
            "explained": self.explained,
            "curve": [list(point) for point in self.curve],
        }


def parts_of(observed: Sequence[Observed], played_m: Sequence[Array], friction_m: float) -> tuple[Part, ...]:
    """Return the parts of a record.

    observed: the strokes, the breakaways and the steps; played_m: the positions in m that the fit gives each, (reading,
    slip); friction_m: F_c/K in m.
    """
    found: list[Part] = []
    for kind, each, at_m in zip((STROKES, BREAKAWAYS, STEPS), observed, played_m, strict=True):
        slips = each.slips
        weight = each.weight[:, slips.begins :].T
        readings_m = slips.measured_m[:, slips.begins :].T
        off_m = np.where(weight > 0.0, readings_m - at_m, np.nan)
        numbers = np.arange(len(at_m)) - (slips.seen - slips.begins)
        time_s = np.broadcast_to((numbers * slips.period_s)[:, None], at_m.shape)
        along = readings_m if kind == STROKES else time_s
        for phase, is_in in _phases(kind, (at_m - at_m[0]) * slips.direction, time_s):
            for direction in (1.0, -1.0):
                chosen = is_in & ~np.isnan(off_m) & (slips.direction == direction)
                if np.count_nonzero(chosen) < _FEWEST:
                    continue
                noise_m = np.sqrt(np.mean(weight[chosen] ** -2.0))
                most_m = _MOST * math.hypot(float(noise_m), _ALLOWED * friction_m)
                off = off_m[chosen]
                curve = _curve(along[chosen], off)
                found.append(Part(kind, phase, direction, float(np.sqrt(np.mean(off * off))), most_m, curve))
    return tuple(found)


def _phases(kind: str, gone_m: Array, time_s: Array) -> Iterator[tuple[str, NDArray[np.bool_]]]:
    """Yield each phase, and which readings (reading, slip) are in it; gone_m: the way of the fitted stem."""
    if kind == STROKES:
        yield "", np.ones_like(gone_m, dtype=bool)
        return
    part = gone_m / np.maximum(gone_m[-1], 1e-9)
    before, after = (part < _BEGUN) & (time_s < 0.0), (part > _DONE) & (time_s >= 0.0)
    yield BEFORE, before
    yield SLIPPING, ~before & ~after
    yield AFTER, after


def _curve(along: Array, off_m: Array) -> tuple[tuple[float, float], ...]:
    """Return the means of residuals in m that are neighbours, with the means of where they are."""
    order = np.argsort(along, kind="stable")
    blocks = np.array_split(order, max(min(_POINTS, len(order) // _FEWEST), 1))
    return tuple((float(np.mean(along[block])), float(np.mean(off_m[block]))) for block in blocks)
