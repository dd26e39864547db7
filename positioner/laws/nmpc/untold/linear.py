"""Small systems of linear equations with a symmetric positive definite matrix: Cholesky's factor. Pure."""

from __future__ import annotations

import math

_LEAST = 1e-300


def factor(matrix: list[list[float]]) -> list[list[float]]:
    """Return the lower triangular L with L·Lᵀ = `matrix`."""
    size = len(matrix)
    lower = [[0.0] * size for _ in range(size)]
    for i in range(size):
        for j in range(i + 1):
            left = matrix[i][j]
            for k in range(j):
                left -= lower[i][k] * lower[j][k]
            lower[i][j] = math.sqrt(max(left, _LEAST)) if i == j else left / lower[j][j]
    return lower


def log_determinant(lower: list[list[float]]) -> float:
    """Return the logarithm of the determinant of L·Lᵀ."""
    total = 0.0
    for i in range(len(lower)):
        total += 2.0 * math.log(lower[i][i])
    return total


def solved(lower: list[list[float]], right: list[float]) -> list[float]:
    """Return x with L·Lᵀ·x = `right`."""
    size = len(right)
    x = right[:]
    for i in range(size):
        for k in range(i):
            x[i] -= lower[i][k] * x[k]
        x[i] /= lower[i][i]
    for i in range(size - 1, -1, -1):
        for k in range(i + 1, size):
            x[i] -= lower[k][i] * x[k]
        x[i] /= lower[i][i]
    return x


def inverse(matrix: list[list[float]]) -> list[list[float]]:
    """Return the inverse of `matrix`."""
    size, lower = len(matrix), factor(matrix)
    columns: list[list[float]] = []
    for i in range(size):
        unit = [0.0] * size
        unit[i] = 1.0
        columns.append(solved(lower, unit))
    return columns
