"""Matrices of what the positioner keeps entry by entry."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from positioner.optimization.qp import QuadraticProgram


class Dense(NamedTuple):
    """A programme with full matrices: P (n, n), q (n,), A (n + H_p, n), l and u (n + H_p,)."""

    P: np.ndarray
    q: np.ndarray
    A: np.ndarray
    l: np.ndarray  # noqa: E741 - the literature's letter
    u: np.ndarray


def dense(program: QuadraticProgram) -> Dense:
    """Return `program` with full matrices."""
    count = len(program.q)
    P, A = np.zeros((count, count)), np.zeros((len(program.l), count))  # noqa: N806 - the literature's letters
    triangle, entries = iter(program.P), iter(program.A)
    for k in range(count):
        for j in range(k + 1):
            P[j, k] = P[k, j] = next(triangle)
        for i in (k, *range(count + k, len(program.l))):
            A[i, k] = next(entries)
    assert next(triangle, None) is None
    assert next(entries, None) is None
    return Dense(P, np.array(program.q), A, np.array(program.l), np.array(program.u))
