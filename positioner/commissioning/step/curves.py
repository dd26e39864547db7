"""The responses as curves for a picture: the part of the realised step over time, at equal distances. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from positioner.commissioning.readings import filled

if TYPE_CHECKING:
    from collections.abc import Sequence

    from positioner.commissioning.step.memory import Response
    from positioner.commissioning.step.result import StepResult

_POINTS, _FEWEST = 60, 12
"""Of a curve after the step: how many it has at most, and how many samples it shows at least."""
_SHOWN = 2.5
"""So many of the longer T86 are shown: five time constants of a first order lag."""
_BEFORE = 0.25
"""So much of the time after the step is shown before it."""


def shown_samples(result: StepResult, size: float) -> int:
    """Return for how many samples after a step of this size its responses are worth showing."""
    medians = [row.spread("t86_s").median for row in result.rows if row.size == size]
    longest_s = max((each for each in medians if not math.isnan(each)), default=math.inf)
    return max(round(min(_SHOWN * longest_s, result.plan.wait_s) / result.period_s), _FEWEST)


def curves(responses: Sequence[Response], result: StepResult) -> list[dict[str, Any]]:
    """Return each response from before the step on, as parts of it, with its times in s, by means over equal times.

    A part is one of the realised step, or of the asked one where the stem did not move.
    """
    found = []
    for each in responses:
        samples = shown_samples(result, each.size)
        width = max(math.ceil(samples / _POINTS), 1)
        step_m = each.direction * (each.final_m - each.before_m)
        whole_m = step_m if step_m > result.seen_m else each.size * result.span_m
        earlier_m, measured_m = each.earlier_m, each.measured_m[: samples // width * width]
        before = min(round(_BEFORE * samples), len(earlier_m)) // width * width
        readings_m = filled(np.array([*earlier_m[len(earlier_m) - before :], *measured_m]))
        parts = each.direction * (readings_m - each.before_m) / whole_m
        parts = parts[: len(parts) // width * width].reshape(-1, width).mean(axis=1)
        times = (np.arange(len(parts)) * width + 0.5 * (width - 1) - before) * result.period_s
        side = "up" if each.direction > 0.0 else "down"
        told = {"size": each.size, "direction": side, "time_s": [float(f"{t:.6g}") for t in times]}
        found.append({**told, "part": [round(float(part), 4) for part in parts]})
    return found
