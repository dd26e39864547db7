"""Random numbers without a state: the n-th draw of a stream follows from the seed alone. Pure.

A plant state can therefore be kept, compared and resumed, and the sensor noise does not depend on the friction draws.
"""

from __future__ import annotations

from enum import IntEnum
from functools import lru_cache

import numpy as np

_BLOCK = 512


class Stream(IntEnum):
    """The uses of random numbers; each has a stream that is independent of the others."""

    SENSOR_NOISE = 1
    FRICTION = 2
    PROCESS = 3
    PRESSURE_NOISE = 4


def normal(seed: int, stream: Stream, index: int) -> float:
    """Return the `index`-th standard normal draw of a stream."""
    return _normals(seed, stream, index // _BLOCK)[index % _BLOCK]


def uniform(seed: int, stream: Stream, index: int) -> float:
    """Return the `index`-th draw of a stream, uniform from -1 to 1."""
    return _uniforms(seed, stream, index // _BLOCK)[index % _BLOCK]


@lru_cache(maxsize=8)
def _normals(seed: int, stream: Stream, block: int) -> tuple[float, ...]:
    return tuple(np.random.default_rng((seed, stream, block)).standard_normal(_BLOCK).tolist())


@lru_cache(maxsize=8)
def _uniforms(seed: int, stream: Stream, block: int) -> tuple[float, ...]:
    return tuple(np.random.default_rng((seed, stream, block)).uniform(-1.0, 1.0, _BLOCK).tolist())
