"""What the law keeps over a restart: where its moves have ended, by place and direction, F_s, and the lag. Pure.

The stiction table keeps a landing bias: the place x where a move has ended, less the one at which its pressure p would
have stopped the configured valve, x - (p - c - s f_c)/k; of a braked move the pressure that would have stopped it, as
it is believed. A law that starts believes these landings as if it had seen them. F_s and the lag are in no landing:
they are in the fit beside them.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.laws.nmpc.belief import LAG, LEAST_LAG_S, SLIDING, SPRING, STATIC, Landing
from positioner.valve.actuator import ActuatorParameters
from positioner.valve.fit import ValveFit
from positioner.valve.stiction import LearnedSample, Quantity, direction_of

if TYPE_CHECKING:
    from positioner.laws.nmpc.belief import ValveBelief
    from positioner.valve.parameters import ValveParameters
    from positioner.valve.stiction import StictionTable

_STATIC, _LAG = 0.02, 0.02
"""What a restart adds to the doubt, as parts: nobody knows what happened meanwhile (`ValveFit.aged` counts days)."""
_LEAST_N, _LEAST_DOUBT = 1e-3, 1e-4


def lesson_of(belief: ValveBelief, landing: Landing, valve: ValveParameters) -> LearnedSample:
    """Return what the stiction table learns from a landing."""
    configured = belief.as_configured
    beside_ma = configured.landing_ma(landing.position_m, landing.direction) - landing.pressure_ma
    bias_m, direction = beside_ma / configured.spring_ma_per_m, direction_of(landing.direction)
    return LearnedSample(Quantity.LANDING_BIAS, landing.position_m, direction, bias_m, fit_of(belief, valve))


def fit_of(belief: ValveBelief, valve: ValveParameters) -> ValveFit:
    """Return K, F_s, F_c and the lags with their covariance, as they are believed."""
    gain, actuator, numbers = valve.force_gain_n_per_ma, valve.actuator, belief.numbers
    count, lag_s = len(numbers.mean), belief.lag_s
    kept = actuator.with_lag(lag_s) if actuator.fill_time_constant_s else ActuatorParameters().with_lag(lag_s)
    relative = (lag_s + LEAST_LAG_S) / max(lag_s, LEAST_LAG_S)

    def both(one: int, other: int) -> float:
        most = math.sqrt(numbers.variances[one] * numbers.variances[other])
        return min(max(numbers.covariance[one * count + other], -most), most)

    return ValveFit(
        spring_n_per_m=gain * belief.spring_ma_per_m,
        static_n=gain * belief.static_ma,
        fill_s=kept.fill_time_constant_s,
        vent_s=kept.vent_time_constant_s,
        kk=gain * gain * both(SPRING, SPRING),
        kf=gain * gain * both(SPRING, STATIC),
        kt=gain * relative * both(SPRING, LAG),
        ff=gain * gain * both(STATIC, STATIC),
        ft=gain * relative * both(STATIC, LAG),
        tt=relative * relative * both(LAG, LAG),
        friction_doubt=min(max(math.sqrt(both(STATIC, STATIC)) / belief.static_ma, _LEAST_DOUBT), 1.0),
        sliding_n=max(gain * belief.sliding_ma, _LEAST_N),
        sliding_n2=gain * gain * both(SLIDING, SLIDING),
    )


def taught(belief: ValveBelief, table: StictionTable, valve: ValveParameters, sigma_m: float) -> ValveBelief:
    """Return the belief after what a table has kept: the landings, the oldest first, then F_s and the lag.

    sigma_m: of the place of a landing, beside the spread of those in its cell.
    """
    configured = belief.as_configured
    landings = [(key, cell) for key, cell in table if key.quantity is Quantity.LANDING_BIAS]
    for key, cell in sorted(landings, key=lambda one: one[1].sequence):
        place_m, direction = key.index * table.cell_width_m, key.direction.sign
        pressure_ma = configured.landing_ma(place_m, direction) - configured.spring_ma_per_m * cell.mean
        variance_m2 = (sigma_m * sigma_m + cell.spread * cell.spread) / len(cell.samples)
        belief = belief.landed(Landing(place_m, direction, pressure_ma), variance_m2, 0.0)
    fit, gain = table.fit, valve.force_gain_n_per_ma
    if fit is None:
        return belief
    static_ma, doubt_ma = fit.static_n / gain, _STATIC * fit.static_n / gain
    static_ma2 = fit.ff / (gain * gain) + doubt_ma * doubt_ma
    belief = belief.measured((0.0,) * STATIC + (1.0,), static_ma, static_ma2)
    own_s, lag_s = valve.actuator.fill_time_constant_s, fit.fill_s
    lag_s *= valve.actuator.lag_s(fills=True) / own_s if own_s else 1.0
    other = belief.with_lag(lag_s)
    if lag_s == 0.0 or (own_s == 0.0 and not other.differs):  # spring and F_v, which are not kept, belong to it
        return belief
    belief = other if other.differs else belief
    relative = max(lag_s, LEAST_LAG_S) / (lag_s + LEAST_LAG_S)
    lag, both, lag2 = math.log(lag_s + LEAST_LAG_S), relative * fit.ft / gain, relative * relative * fit.tt
    by_static = both / static_ma2  # what is independent of F_s in the lag
    line, value = (0.0,) * STATIC + (-by_static, 1.0), lag - by_static * static_ma
    return belief.measured(line, value, lag2 + _LAG * _LAG - by_static * both)
