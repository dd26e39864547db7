"""The responses as curves for a picture: the part of the realised step over time, at equal distances. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from positioner.commissioning.readings import filled

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from positioner.commissioning.step.memory import Response
    from positioner.commissioning.step.result import StepResult

_POINTS = 60
_SHOWN = 3.0
"""So many of the longest T86 are shown."""


def normalised(response: Response, result: StepResult) -> NDArray[np.float64]:
    """Return the readings as parts of the realised step, or of the asked one where the stem did not move."""
    step_m = response.direction * (response.final_m - response.before_m)
    whole_m = step_m if step_m > result.seen_m else response.size * result.span_m
    return np.asarray(response.direction * (filled(np.asarray(response.measured_m)) - response.before_m) / whole_m)


def shown_s(result: StepResult) -> float:
    """Return for how long after a step the responses are worth showing, in s."""
    longest = [row.spread("t86_s").high for row in result.rows if row.moved]
    return min(_SHOWN * max((each for each in longest if not math.isnan(each)), default=math.inf), result.plan.wait_s)


def curves(responses: Sequence[Response], result: StepResult) -> list[dict[str, Any]]:
    """Return each response with its times in s, by means over equal times."""
    samples = max(round(shown_s(result) / result.period_s), 2)
    width = max(math.ceil(samples / _POINTS), 1)
    found = []
    for each in responses:
        parts = normalised(each, result)[:samples]
        parts = parts[: len(parts) // width * width].reshape(-1, width).mean(axis=1)
        times = (np.arange(len(parts)) * width + 0.5 * (width - 1)) * result.period_s
        side = "up" if each.direction > 0.0 else "down"
        told = {"size": each.size, "direction": side, "time_s": [float(f"{t:.6g}") for t in times]}
        found.append({**told, "part": [round(float(part), 4) for part in parts]})
    return found
