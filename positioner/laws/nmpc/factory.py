"""Makes the law of a valve. Pure, but for the solver passed in."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.laws.nmpc.braking import Braking
from positioner.laws.nmpc.judging import Judge
from positioner.laws.nmpc.law import NmpcLaw
from positioner.laws.nmpc.move import Limits, Stem
from positioner.laws.nmpc.programme import NEAR, StopPlanner
from positioner.valve.rollout import plant_of
from positioner.valve.sensor import sensor_lag

if TYPE_CHECKING:
    from positioner.laws.estimator_settings import EstimatorSettings
    from positioner.optimization.qp import Solver
    from positioner.valve.parameters import ValveParameters


def nmpc_law(
    valve: ValveParameters,
    estimator: EstimatorSettings,
    currents_ma: tuple[float, float],
    period_s: float,
    delay_s: float,
    *,
    solver: Solver | None = None,
    rate_ma_per_s: float = math.inf,
) -> NmpcLaw:
    """Return the law of a valve.

    Args:
        valve: as configured.
        estimator: the configured noise of its sensor.
        currents_ma: the lowest and the highest current.
        period_s: of the readings.
        delay_s: from a reading until its command acts.
        solver: of the braked moves; None where none are made, as by the law `quasi-static`.
        rate_ma_per_s: the largest rate of the current.
    """
    plant, limits = plant_of(valve, period_s, delay_s), Limits(*currents_ma, valve.travel_min_m, valve.travel_max_m)
    stem = Stem(plant.mass, plant.viscous)
    judge, sensor = Judge(valve, estimator, stem, period_s), sensor_lag(valve.sensor_time_constant_s, period_s)
    braking = None
    if solver is not None:
        planner = StopPlanner(solver, limits, NEAR * valve.span_m)
        braking = Braking(judge, limits, plant, sensor, planner, rate_ma_per_s * period_s)
    return NmpcLaw("nmpc", judge, limits, plant, braking=braking, rate_ma_per_s=rate_ma_per_s)
