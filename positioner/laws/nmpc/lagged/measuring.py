"""How a reading of the pressure corrects what the law carries: the pressure, the lags and the highest current. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.laws.nmpc.lagged.measured import unmeasured
from positioner.laws.nmpc.lagged.memory import Ramp
from positioner.laws.nmpc.lagged.rest import LaggedRest
from positioner.values import replace

if TYPE_CHECKING:
    from positioner.laws.nmpc.lagged.memory import LaggedMemory
    from positioner.laws.nmpc.lagged.valve import LaggedValve

_OTHER_LAG = 0.005
"""The actuator's model changes when a lag differs by this part of it."""
_RETRIED = 1.005
"""With each move the highest current grows by this factor again, since a supply may recover."""
_LEAST_LIMIT_MA = 8.0
_PATIENCE = 0.5
"""So many lags it takes to tell a low supply from a sensor that fails."""
_REFUSED = "the measured pressure contradicts the commands, and is not used"
_USED = "the measured pressure fits the commands, and is used again"


def with_pressure(valve: LaggedValve, memory: LaggedMemory, reading_ma: float) -> LaggedMemory:
    """Return the memory after a reading of the pressure, in mA of the configured pressure gain."""
    if not valve.has_lag:
        return memory
    doubt, pipeline, drive = valve.settings.lag_doubt, memory.pipeline, memory.drive
    measured = memory.measured
    if measured is None:
        fill, vent = drive.fill_s / valve.drive.fill_s, drive.vent_s / valve.drive.vent_s
        measured = unmeasured(memory.belief.onsets.tt, fill, vent)
    noise = measured.noise.at_rest(reading_ma) if isinstance(memory.stem, LaggedRest) else measured.noise.in_motion()
    if not noise.is_known:
        return replace(memory, measured=measured.with_noise(noise, pipeline.doubt_ma))
    was_trusted, notice = measured.trusted, memory.notice
    patience = _PATIENCE * valve.drive.fill_s / valve.period_s
    measured, pressure_ma = measured.corrected(pipeline.pressure_ma, reading_ma, noise.variance_ma2, patience)
    if measured.trusted is not was_trusted:
        notice = _REFUSED if was_trusted else _USED
    if not measured.trusted:
        return replace(memory, measured=measured, notice=notice)
    pipeline = pipeline.measured(pressure_ma, measured.pp)
    read_ma, sigma_ma = reading_ma - measured.offset_ma, math.sqrt(noise.variance_ma2)
    supply, limit_ma = measured.supply.after(valve.drive, read_ma, pipeline.acting_ma, pipeline.converter_ma, sigma_ma)
    measured = replace(measured, noise=noise, supply=supply)
    stem = memory.stem
    if limit_ma is not None and limit_ma > _LEAST_LIMIT_MA:
        measured = measured.with_unknown_fill(doubt)
        drive = drive.with_limit(min(limit_ma, drive.high_ma))
        notice = f"the pressure does not rise above {limit_ma:.1f} mA: check the air supply"
    elif isinstance(stem, Ramp) and stem.readings == 0 and drive.high_ma < valve.drive.high_ma:
        drive = drive.with_limit(min(_RETRIED * drive.high_ma, valve.drive.high_ma))
    fill_s, vent_s = valve.drive.fill_s * measured.fill, valve.drive.vent_s * measured.vent
    if abs(fill_s - drive.fill_s) > _OTHER_LAG * fill_s or abs(vent_s - drive.vent_s) > _OTHER_LAG * vent_s:
        drive = drive.with_lags(fill_s, vent_s)
    return replace(memory, measured=measured, pipeline=pipeline, drive=drive, notice=notice)
