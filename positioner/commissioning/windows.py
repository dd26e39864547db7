"""From recorded stretches to what the fit compares: slips side by side, with the weight of each reading. Pure."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from positioner.commissioning.observed import Observed
from positioner.commissioning.readings import filled
from positioner.commissioning.record import Kind
from positioner.commissioning.slips import Slips

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from positioner.commissioning.noise import Noise
    from positioner.commissioning.procedure import ProcedureLimits
    from positioner.commissioning.record import Stretch

    Array = NDArray[np.float64]

_BEFORE_S = 0.2
_AFTER_S = 0.4
_STROKE_PERIOD_S = 0.005
_STROKE_STEP_S = 0.0025
_LEAD_S = 1.5
"""So much of the currents before is played first, for the pressure."""
_SMOOTH_S = 0.1
_SETTLED_S = 0.3
_FLOOR_OF_SPAN = {Kind.STROKE: 3e-5, Kind.STEP: 3e-4, Kind.BREAKAWAY: 3e-3}
"""The model itself is not more exact than this part of the span. A slip under a slow ramp begins a millisecond earlier
or later by the least change of force; its way is then no measure of the parameters."""
_CREEP_OF_SPAN = 0.02
_END_OF_SPAN = 0.02


def releases(
    stretches: Sequence[Stretch],
    kind: Kind,
    noise: Noise,
    limits: ProcedureLimits,
    period_s: float,
    creep_m_per_s2: float = 1.0,
) -> Observed | None:
    """Return the breakaways, or the steps, side by side with the moment at which each was seen; None without any.

    creep_m_per_s2: how a stem with strong damping gains speed under the ramp, B·r/F_v; it is seen to move late.
    """
    found = [each for each in stretches if each.kind is kind]
    if not found:
        return None
    before = max(each.slip for each in found)
    after = min(*(len(each.measured_m) - each.slip for each in found), max(round(_AFTER_S / period_s), 2))
    sigma_m = max(float(noise.sigma_m(each.measured_m[0])) for each in found)
    before_s = _BEFORE_S + 2.0 * np.sqrt(2.0 * max(1.5 * sigma_m, 1e-3 * limits.span_m) / creep_m_per_s2)
    longest = max(each.slip - each.held for each in found)
    played = max(longest + 1 if kind is Kind.STEP else min(round(before_s / period_s), longest), 2)
    before += round(_LEAD_S / period_s)
    count = before + after
    applied, measured = np.empty((len(found), count)), np.full((len(found), count), np.nan)
    rest_m, rest_sigma_m = np.empty(len(found)), np.empty(len(found))
    tails = _tails(stretches, kind, before)
    for number, each in enumerate(found):
        begin, end = before - each.slip, each.slip + after
        applied[number, :begin] = each.applied_ma[0]
        tail = tails[number][-begin:]
        applied[number, begin - len(tail) : begin] = tail
        applied[number, begin:] = each.applied_ma[:end]
        measured[number, begin:] = each.measured_m[:end]
        held = np.asarray(each.measured_m[each.held // 4 : each.held])
        rest_m[number] = np.nanmean(held)
        sigma_m = float(noise.sigma_m(rest_m[number]))
        rest_sigma_m[number] = max(sigma_m / np.sqrt(len(held)) * noise.correlation, 1e-6)
    slips = Slips(
        period_s, np.array([each.direction for each in found]), applied, measured, max(before - played, 1), seen=before
    )
    places_m = np.broadcast_to(rest_m[:, None], measured.shape)
    return Observed(slips, _weights(measured, places_m, kind, noise, limits), rest_m, rest_sigma_m)


def _tails(stretches: Sequence[Stretch], kind: Kind, most: int) -> list[tuple[float, ...]]:
    """Return the currents before each stretch of `kind`, where a release led to it: a long lag still remembers them."""
    return [
        before.applied_ma[-most:] if before and before.kind in {Kind.BREAKAWAY, Kind.STEP} else ()
        for before, each in pairwise((None, *stretches))
        if each and each.kind is kind
    ]


def strokes(stretches: Sequence[Stretch], noise: Noise, limits: ProcedureLimits, period_s: float) -> Observed | None:
    """Return the sliding parts of the strokes, in blocks of some milliseconds; None without any."""
    found = [each for each in stretches if each.kind is Kind.STROKE]
    if not found:
        return None
    size = max(2 * round(0.5 * _STROKE_PERIOD_S / period_s - 0.5) + 1, 1)  # odd, so that a block has a middle
    block_s = size * period_s
    lead = round(_LEAD_S / block_s)
    count = max(len(each.measured_m) // size for each in found) + lead
    applied, measured = np.empty((len(found), count)), np.full((len(found), count), np.nan)
    rest_m = np.empty(len(found))
    weight = np.zeros_like(measured)
    tail = np.full(lead, found[0].applied_ma[0])
    for number, each in enumerate(found):
        # the mean reading is that of the middle of its block, so the currents begin half a block earlier
        early = (size - 1) // 2
        shifted = (*([each.applied_ma[0]] * early), *each.applied_ma[: len(each.applied_ma) - early])
        readings, currents = _blocks(each.measured_m, size), _blocks(shifted, size)
        begin = count - len(readings)
        applied[number, begin:] = currents
        applied[number, :begin] = np.r_[np.full(begin - lead, tail[0]), tail]
        measured[number, begin:] = readings
        rest_m[number] = np.nanmean(readings[: max(round(0.2 / block_s), 1)])
        smooth_m = _smooth(readings, max(round(_SMOOTH_S / block_s), 1))
        weights = _weights(readings, smooth_m, Kind.STROKE, noise, limits) * np.sqrt(size) / noise.correlation
        weight[number, begin:] = np.where(
            _slides(each, smooth_m, currents, rest_m[number], limits, block_s), weights, 0.0
        )
        tail = currents[-lead:]
    slips = Slips(block_s, np.array([each.direction for each in found]), applied, measured, lead // 2, _STROKE_STEP_S)
    # a stem with strong damping still creeps when the next stroke begins
    return Observed(slips, weight, rest_m, np.full(len(found), _CREEP_OF_SPAN * limits.span_m))


def _blocks(samples: Sequence[float], size: int) -> Array:
    """Return the means of whole blocks; NaN where all readings of one were lost."""
    values = np.asarray(samples[: len(samples) // size * size]).reshape(-1, size)
    counts = np.count_nonzero(~np.isnan(values), axis=1)
    return np.asarray(np.where(counts > 0, np.nansum(values, axis=1) / np.maximum(counts, 1), np.nan))


def _slides(
    each: Stretch, smooth_m: Array, currents: Array, rest_m: float, limits: ProcedureLimits, block_s: float
) -> NDArray[np.bool_]:
    """Return where the stem slides: some time after it has left its place, until the ramp ends."""
    gone_m = each.direction * (smooth_m - rest_m)
    moved = np.flatnonzero(gone_m > max(0.15 * float(gone_m.max()), 0.01 * limits.span_m))
    slides = np.zeros(len(smooth_m), dtype=bool)
    if len(moved):
        slides[moved[0] + round(_SETTLED_S / block_s) : np.flatnonzero(currents != currents[-1])[-1]] = True
    return slides


def _weights(readings: Array, places_m: Array, kind: Kind, noise: Noise, limits: ProcedureLimits) -> Array:
    """Return 1/σ of each reading in 1/m; 0 for a lost one, and near a stop, which the model does not know.

    places_m: where the stem is, without the noise of the single reading, which must not decide its own weight.
    """
    sigma_m = np.hypot(noise.sigma_m(places_m), _FLOOR_OF_SPAN[kind] * limits.span_m)
    margin_m = _END_OF_SPAN * limits.span_m
    inside = (places_m > limits.travel_min_m + margin_m) & (places_m < limits.travel_max_m - margin_m)
    return np.where(np.isnan(readings) | ~inside, 0.0, 1.0 / sigma_m)


def _smooth(readings: Array, width: int) -> Array:
    """Return the running mean over `width` samples; a lost reading counts as the one before."""
    whole = np.nan_to_num(filled(readings))
    around = np.r_[np.full(width // 2, whole[0]), whole, np.full(width - 1 - width // 2, whole[-1])]
    return np.asarray(np.convolve(around, np.ones(width) / width, "valid"))
