"""Whether the error of a resting stem is worth a move, and which. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.laws.move_reason import Breakaway, MoveReason
from positioner.laws.nmpc.lagged import ramping
from positioner.laws.nmpc.lagged.judging import judged
from positioner.laws.nmpc.lagged.move_plan import Planner
from positioner.values import replace

if TYPE_CHECKING:
    from positioner.laws.law import Observation
    from positioner.laws.nmpc.lagged.memory import LaggedMemory
    from positioner.laws.nmpc.lagged.rest import LaggedRest
    from positioner.laws.nmpc.lagged.valve import LaggedValve


def considered(
    valve: LaggedValve, memory: LaggedMemory, rest: LaggedRest, observation: Observation, sigma_m: float
) -> tuple[LaggedMemory, MoveReason | None]:
    """Return the memory, on a ramp if the error is worth a move, and why the move begins."""
    own, setpoint_m = valve.settings, observation.setpoint_m
    is_first = memory.belief.seen == 0 and rest.readings < _FIRST_READINGS
    if rest.settle_s > _INSTANT_S or is_first:
        return memory, None
    tolerance_m = valve.tolerance_m(sigma_m)
    patience = own.patience * max(valve.period_s / _LONG_PERIOD_S, 1.0)
    patient_m = tolerance_m * (1.0 + patience * memory.corrections)
    is_long = rest.readings * valve.period_s > _LONG_AVERAGE_S
    certain = rest.sigma_m < (1.0 if is_long else own.certain_part) * patient_m
    error_m, corrections = setpoint_m - rest.x, memory.corrections
    beyond_m = patient_m + _FAR * rest.sigma_m
    if certain:
        beyond_m = (_STAYS if rest.stays else _WORTH) * patient_m
    is_far = abs(error_m) > beyond_m
    if certain or is_far:
        memory = judged(valve, memory, rest)
    go = False
    if memory.is_new and abs(error_m) > tolerance_m + _DOUBT * rest.sigma_m:
        go = True
    elif not memory.is_final:
        go = certain or rest.sigma_m < _ASIDE * sigma_m
    elif corrections < own.most_corrections:
        go = is_far
        corrections += 1 if go else 0
    if certain and not go and (memory.is_new or not rest.stays):
        memory = replace(memory, is_new=False, stem=replace(rest, stays=True))
    if not go or not memory.pushes.may_push(observation.time_s):
        return memory, None
    planner = Planner(own, valve.model, memory.drive, valve.sensor, valve.delay_samples, 0.7 * valve.gap_n)
    move = planner.plan(
        memory.belief,
        rest,
        setpoint_m,
        memory.pipeline.pressure_ma,
        sigma_m,
        observation.time_s,
        corrections,
        is_second=not memory.is_final,
    )
    onsets, s = memory.belief.onsets, move.direction
    ramp = ramping.begun(move, rest, memory.pipeline)
    memory = replace(
        memory,
        stem=ramp,
        corrections=corrections,
        is_final=move.is_final,
        is_new=False,
        attempt=None,
        noise=memory.noise.at_new_place(),
    )
    free_ma = valve.model.pressure_ma(onsets.spring_n_per_m * rest.x + s * onsets.static_n)
    return memory, MoveReason(error_m, Breakaway(free_ma), move.aim_m)


_FAR = 2.5
"""An error is corrected at once when it exceeds the tolerance by so many σ of the average."""
_WORTH, _STAYS = 1.25, 2.0
"""When the average is certain, the error is judged once: it is corrected where it exceeds so many tolerances. A stem
that stays moves again for a far larger error only: an average that becomes better must not find a new error late."""
_LONG_AVERAGE_S = 1.0
"""After this time σ below the whole tolerance is enough: at a period of 20 ms and 2 % noise an average needs 5 s to be
certain, and a correction so late is itself the error."""
_LONG_PERIOD_S = 0.005
"""With a longer period the patience is greater in proportion: few readings show a slip, and its landing scatters."""
_ASIDE = 0.25
"""A stem that has moved aside goes on when σ of the average is below this part of a reading's: it averages on."""
_DOUBT = 2.0
"""A new setpoint is pursued when the error exceeds the tolerance by so many σ of the average."""
_FIRST_READINGS = 20
"""Readings before the first move: so many show whether the sensor is as noisy as configured."""
_INSTANT_S = 1e-9
"""Rounding of a sum of periods."""
