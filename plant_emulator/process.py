"""The force of the process on the plug: constant, growing with the travel, noise, and a sine. Pure.

The constant part acts like a preload, the gradient like a spring. The noise is a white sequence, held for a quarter of
its correlation time and filtered once: ṅ = (w_k - n)/τ_n, τ_n = 1/(2π·bandwidth). So it is continuous, and one
exponential between two edges. The sine is drawn in 32 straight pieces a period, which are at most
1 - cos(π/32) = 0.5 % of its amplitude away from it.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TYPE_CHECKING

from plant_emulator.draws import Stream, normal
from plant_emulator.force import PushingForce

if TYPE_CHECKING:
    from plant_emulator.parameters import ProcessSettings

_HOLD = 0.25
"""Of the correlation time: how long one value of the white sequence lasts."""
_HOLD_SLACK = 1e-9
"""Of a hold: an instant this little before its end belongs to the next hold, however it was rounded."""
_PIECES = 32
"""Straight pieces in one period of the sine."""


def initial_noise_n(settings: ProcessSettings, seed: int) -> float:
    """Return the noise at the start of a plant, in N."""
    return settings.noise_n * normal(seed, Stream.PROCESS, 0) if settings.noise_n else 0.0


def disturbed(
    settings: ProcessSettings,
    seed: int,
    noise_n: float,
    start_s: float,
    forces: tuple[tuple[PushingForce, float], ...],
) -> tuple[float, tuple[tuple[PushingForce, float], ...]]:
    """Return the noise in N after `forces`, (force, seconds) each from `start_s` on, and these with noise and sine."""
    if settings.sine_n > 0.0:
        forces = _with_sine(settings, start_s, forces)
    if settings.noise_n == 0.0:
        return noise_n, forces
    lag_s = 1.0 / (math.tau * settings.noise_bandwidth_hz)
    hold_s, white_n = _HOLD * lag_s, settings.noise_n * _white_over_rms()
    index = math.floor(start_s / hold_s + _HOLD_SLACK)
    now_s, disturbed_forces = start_s, []
    for given, seconds in forces:
        force, left_s = given, seconds
        while left_s > 0.0:
            held_n = white_n * normal(seed, Stream.PROCESS, index + 1)
            until_s = (index + 1) * hold_s - now_s
            ends = until_s <= left_s
            part_s = max(until_s, 0.0) if ends else left_s
            decays = (*force.decays, (held_n - noise_n, 1.0 / lag_s))
            disturbed_forces.append((PushingForce(force.final_n - held_n, decays, force.ramp_n_per_s), part_s))
            noise_n = held_n + (noise_n - held_n) * math.exp(-part_s / lag_s)
            now_s, left_s, index = now_s + part_s, left_s - part_s, index + ends
            force = force.after(part_s)
    return noise_n, tuple(disturbed_forces)


def _with_sine(
    settings: ProcessSettings, start_s: float, forces: tuple[tuple[PushingForce, float], ...]
) -> tuple[tuple[PushingForce, float], ...]:
    """Return `forces` less the sine, each divided where one straight piece of it ends."""
    piece_s = 1.0 / (_PIECES * settings.sine_hz)
    index = math.floor(start_s / piece_s + _HOLD_SLACK)
    now_s, found = start_s, []
    for given, seconds in forces:
        force, left_s = given, seconds
        while left_s > 0.0:
            begin_n = settings.sine_n * math.sin(math.tau * index / _PIECES)
            end_n = settings.sine_n * math.sin(math.tau * (index + 1) / _PIECES)
            slope = (end_n - begin_n) / piece_s
            until_s = (index + 1) * piece_s - now_s
            ends = until_s <= left_s
            part_s = max(until_s, 0.0) if ends else left_s
            here_n = begin_n + slope * (now_s - index * piece_s)
            found.append((PushingForce(force.final_n - here_n, force.decays, force.ramp_n_per_s - slope), part_s))
            now_s, left_s, index = now_s + part_s, left_s - part_s, index + ends
            force = force.after(part_s)
    return tuple(found)


@lru_cache(maxsize=1)
def _white_over_rms() -> float:
    """Return the size of the white sequence over that of the filtered noise, the mean over time.

    Within a hold of h = H·τ_n the variance goes from V at its ends by V·e^(-2t/τ_n) + W·(1 - e^(-t/τ_n))², with
    V = W·(1 - a)/(1 + a) and a = e^(-H); W is the variance of the sequence.
    """
    a = math.exp(-_HOLD)
    ends = (1.0 - a) / (1.0 + a)
    squares = (1.0 - a * a) / (2.0 * _HOLD)
    mean = ends * squares + 1.0 - 2.0 * (1.0 - a) / _HOLD + squares
    return 1.0 / math.sqrt(mean)
