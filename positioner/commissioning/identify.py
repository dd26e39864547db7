"""From the record of an experiment to the parameters of the valve, each with its 95 % interval. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from positioner.commissioning.explained import parts_of
from positioner.commissioning.first_guess import bound, first_guess, part_of, stribeck_is_seen
from positioner.commissioning.fit import Beginning, Prior, fits, positions_of
from positioner.commissioning.identified import IdentifiedValve, Interval
from positioner.commissioning.noise import noise_of
from positioner.commissioning.observed import (
    COULOMB,
    DEAD,
    FILL,
    PRELOAD,
    SPRING,
    STATIC,
    STRIBECK,
    VENT,
    VISCOUS,
    excess,
    residuals,
    theta_of,
    weakened,
)
from positioner.commissioning.pressure import times_of
from positioner.commissioning.record import Kind
from positioner.commissioning.release import RAMP_MA_PER_S
from positioner.commissioning.windows import releases, strokes
from positioner.errors import PositionerError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from positioner.commissioning.explained import Part
    from positioner.commissioning.fit import Fitted
    from positioner.commissioning.noise import Noise
    from positioner.commissioning.observed import Observed
    from positioner.commissioning.procedure import ProcedureLimits
    from positioner.commissioning.record import Stretch
    from positioner.valve.parameters import ValveParameters

    Array = NDArray[np.float64]

_Z = 1.96
_ONE_SIDED = 1.645
_WIDE, _DOUBTFUL = 10.0, 0.7
"""Relative σ before the experiment: of what it certainly shows, and of F_v and V_s."""
_SEEN = 0.5
"""F_v and V_s count as seen if the experiment halves their σ."""
_LEAST_SCATTER, _ROUNDS = 5e-4, 4
_MODEL_ERROR = {SPRING: 3e-4, STATIC: 1e-3, COULOMB: 1e-3, VISCOUS: 0.02, STRIBECK: 0.05}
"""Relative errors of the model itself, which more readings do not reduce."""
_MODEL_ERROR_PERIODS = 0.1
"""That of the times, in sample periods."""
_FEWEST = 4
_ALIKE_S = 0.25
"""Residuals that the model causes are alike for so long."""
_HELD = 1e-5


class IdentifyError(PositionerError):
    """The record does not show what it should: the message names what is missing."""


def identify(
    stretches: Sequence[Stretch],
    valve: ValveParameters,
    limits: ProcedureLimits,
    period_s: float,
    report: Callable[[float], object] = lambda _part: None,
) -> IdentifiedValve:
    """Return the parameters that the record of an experiment shows; `report` receives the part that is done.

    `valve` is the believed one. Its mass and force per mA are taken over, because a record of current and position
    shows forces only as multiples of the current.

    Raises:
        IdentifyError: too few strokes, breakaways or steps.
    """
    noise = noise_of(stretches)
    slow = strokes(stretches, noise, limits, period_s)
    creep = valve.force_gain_n_per_ma * RAMP_MA_PER_S / valve.viscous_friction_n_s_per_m
    ramps = releases(stretches, Kind.BREAKAWAY, noise, limits, period_s, creep)
    steps = releases(stretches, Kind.STEP, noise, limits, period_s)
    for what, found in (("strokes", slow), ("breakaways", ramps), ("steps", steps)):
        if found is None or len(found.rest_m) < _FEWEST or not found.weight.any():
            count = 0 if found is None else len(found.rest_m)
            raise IdentifyError(f"too few {what} in this record to identify the valve: {count}, needed {_FEWEST}")
    assert slow is not None and ramps is not None and steps is not None  # noqa: S101, PT018 - checked above
    observed = (slow, ramps, steps)
    gain, prior = valve.force_gain_n_per_ma, _prior(valve)
    report(0.05)
    theta, slips = first_guess(
        slow, ramps, steps, valve.mass_kg, gain, prior, RAMP_MA_PER_S, part_of(report, 0.05, 0.3)
    )
    if not stribeck_is_seen(slow, gain, theta, prior):
        prior = bound(prior, prior.theta, [STRIBECK])
    report(0.3)
    if (shown := times_of(stretches, period_s)) is not None:
        times = [FILL, VENT, DEAD]
        theta[times] = prior.theta[times] = shown[0]
        prior.sigma[times] = shown[1]
    scatter = max(_LEAST_SCATTER, 1.48 * float(np.median(np.abs(slips[1]))))
    slips[1] = np.clip(slips[1], -3.0 * scatter, 3.0 * scatter)
    own: tuple[Array, ...] = (np.zeros((2, len(slow.rest_m))), slips, np.zeros((2, len(steps.rest_m))))
    wrong = np.ones(len(observed))
    for number in range(_ROUNDS):
        believed = [weakened(each, by) for each, by in zip(observed, wrong, strict=True)]
        tell = part_of(report, *(0.3 + 0.7 * part / _ROUNDS for part in (number, number + 1)))
        begins = [Beginning(prior, theta, own)]
        (fitted,) = fits(believed, valve.mass_kg, gain, begins, scatter, tell=tell)
        theta, own, before = fitted.theta, fitted.own, np.array([scatter * scatter, *wrong])
        scatter = max(fitted.friction_sigma, _LEAST_SCATTER)
        played = positions_of(observed, valve.mass_kg, gain, fitted)
        left = [residuals(each, at[:, None, :])[:, 0, :] for each, at in zip(observed, played, strict=True)]
        wrong = np.array([_excess(each, off) for each, off in zip(observed, left, strict=True)])
        report(0.3 + 0.7 * (number + 1) / _ROUNDS)
        if np.all(np.abs(np.array([scatter * scatter, *wrong]) - before) < 0.4 * before):
            break
    squares = np.array([[float(np.sum(off * off)), np.count_nonzero(off)] for off in left])
    total = squares.sum(axis=0)
    misfits = float(total[0] / total[1]), float(squares[-1, 0] / squares[-1, 1])
    parts = parts_of(observed, played, float(theta[COULOMB] / theta[SPRING]))
    return _result(fitted, misfits, parts, observed, noise, valve, limits, period_s)


def _excess(observed: Observed, off: Array) -> float:
    """Return by how much the variance of the residuals (reading, slip) exceeds that of the noise, in blocks of time."""
    counts = observed.weight[:, observed.slips.begins :].T > 0.0
    block = max(round(_ALIKE_S / observed.slips.period_s), 1)
    return excess(np.concatenate([off[counts[:, slip], slip] for slip in range(off.shape[1])]), block)


def _prior(valve: ValveParameters) -> Prior:
    theta = theta_of(valve)
    sigma = np.full(len(theta), _WIDE)
    sigma[PRELOAD] = _WIDE * max(valve.static_friction_n, valve.force_gain_n_per_ma)
    sigma[[VISCOUS, STRIBECK]] = _DOUBTFUL
    return Prior(theta, sigma)


def _result(
    fitted: Fitted,
    misfits: tuple[float, float],
    parts: tuple[Part, ...],
    observed: Sequence[Observed],
    noise: Noise,
    valve: ValveParameters,
    limits: ProcedureLimits,
    period_s: float,
) -> IdentifiedValve:
    covariance = fitted.covariance
    sigma = np.sqrt(np.diag(covariance))
    # too long a dead time is poison for a law, and too short a one nearly harmless
    most_s = float(fitted.theta[DEAD])
    dead_s = max(most_s - _ONE_SIDED * float(sigma[DEAD]), 0.0)
    dead_s = dead_s if dead_s > _MODEL_ERROR_PERIODS * period_s else 0.0
    # the others follow the dead time, as the readings bind them to it
    bound = covariance[:, DEAD] / max(covariance[DEAD, DEAD], 1e-18) * (dead_s - most_s)

    def relative(number: int) -> Interval:
        if sigma[number] < _HELD:  # it was not looked for
            value = valve.stribeck_velocity_m_per_s
            return Interval(value, 0.0, np.inf, seen=False)
        error = _Z * float(np.hypot(sigma[number], _MODEL_ERROR[number]))
        value = float(fitted.theta[number] * np.exp(bound[number]))
        seen = number not in {VISCOUS, STRIBECK} or bool(sigma[number] < _SEEN * _DOUBTFUL)
        middle = float(fitted.theta[number])
        ends = min(value, middle * np.exp(-error)), max(value, middle * np.exp(error))
        believed = {VISCOUS: valve.viscous_friction_n_s_per_m, STRIBECK: valve.stribeck_velocity_m_per_s}
        return Interval(value if seen else believed[number], float(ends[0]), float(ends[1]), seen)

    def time(number: int) -> Interval:
        error_s = _Z * float(np.hypot(sigma[number], _MODEL_ERROR_PERIODS * period_s))
        middle_s = float(fitted.theta[number])
        value_s = dead_s if number == DEAD else max(middle_s + float(bound[number]), 0.0)
        return Interval(value_s, max(min(value_s, middle_s - error_s), 0.0), max(value_s, middle_s + error_s))

    fill, vent = time(FILL), time(VENT)
    if fill.low == 0.0 and vent.low == 0.0:  # a lag that is not certain is none
        fill, vent = Interval(0.0, 0.0, fill.high), Interval(0.0, 0.0, vent.high)
    else:
        least_s = 0.1 * period_s
        fill, vent = (Interval(max(each.value, least_s), each.low, each.high) for each in (fill, vent))
    preload_n = float(fitted.theta[PRELOAD])
    error_n = _Z * float(np.hypot(sigma[PRELOAD], 1e-3 * fitted.theta[STATIC]))
    static = relative(STATIC)
    coulomb = relative(COULOMB)
    span_noise = noise.of_span_m / limits.span_m
    wide = _Z * max(noise.error, 0.01)
    return IdentifiedValve(
        spring_rate_n_per_m=relative(SPRING),
        # a preload that is not certain is none
        bench_set_n=Interval(preload_n if preload_n > error_n else 0.0, preload_n - error_n, preload_n + error_n),
        static_friction_n=static,
        coulomb_friction_n=coulomb,
        viscous_friction_n_s_per_m=relative(VISCOUS),
        stribeck_velocity_m_per_s=relative(STRIBECK),
        fill_time_constant_s=fill,
        vent_time_constant_s=vent,
        dead_time_s=time(DEAD),
        noise_of_reading=Interval(noise.of_reading, noise.of_reading * (1.0 - wide), noise.of_reading * (1.0 + wide)),
        noise_of_span=Interval(span_noise, span_noise * (1.0 - wide), span_noise * (1.0 + wide)),
        friction_scatter=fitted.friction_sigma,
        noise_correlation=noise.correlation,
        breakaways=len(observed[1].rest_m),
        steps=len(observed[2].rest_m),
        misfit=misfits[0],
        step_misfit=misfits[1],
        parts=parts,
    )
