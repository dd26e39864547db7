"""One-step regressions of PV on its past, on OP and on a modelled stem, for many stems at once. Pure.

No regression has OP or the stem at lag 0: a PI controller makes OP a function of PV of the same sample, and the
"process" that is found then is the controller.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_RIDGE = 1e-6


def lagged(values: Array, lags: range, longest: int) -> Array:
    """Return the values of (sample, lag) for the samples from `longest` on."""
    return np.stack([values[longest - lag : values.shape[0] - lag] for lag in lags], axis=1)


def residual_sum(target: Array, regressors: Array, weight: Array) -> float:
    """Return the sum of squares that a regression leaves, with a constant; weight is 0 for samples to leave out."""
    _, left = _without(target, regressors, weight)
    return float(left @ left)


def added_sums(target: Array, base: Array, added: Array, weight: Array) -> Array:
    """Return what each set of further regressors, of (set, sample, lag), leaves beside those of `base`."""
    orthogonal, left = _without(target, base, weight)
    found = np.empty(added.shape[0])
    for number in range(added.shape[0]):
        more = added[number] * weight[:, None]
        more = more - orthogonal @ (orthogonal.T @ more)
        size = np.sqrt(np.maximum(np.sum(more * more, axis=0), 1e-300))
        more = more / size
        normal = more.T @ more + _RIDGE * np.eye(more.shape[1])
        right = more.T @ left
        found[number] = float(left @ left - right @ np.linalg.solve(normal, right))
    return found


def _without(target: Array, regressors: Array, weight: Array) -> tuple[Array, Array]:
    """Return an orthogonal basis of the regressors and a constant, and what they leave of the target.

    By QR: neighbouring lags of a slow OP are almost equal, and normal equations would lose what tells them apart.
    """
    orthogonal, _ = np.linalg.qr(_with_constant(regressors) * weight[:, None])
    wanted = target * weight
    return orthogonal, np.asarray(wanted - orthogonal @ (orthogonal.T @ wanted))


def _with_constant(regressors: Array) -> Array:
    return np.concatenate([regressors - np.mean(regressors, axis=0), np.ones((regressors.shape[0], 1))], axis=1)
