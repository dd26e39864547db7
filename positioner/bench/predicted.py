"""Where the law's model of the valve takes the stem, from the law's own estimate under the commands of the run. Pure.

The model has the parameters that the law had learned when the move began: its fit, or what the stiction table implies,
as after a restart; else the configured ones. It begins where the law begins a move, or sees the stem slide.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from positioner.laws.nmpc.breakaway import load_from_table
from positioner.laws.nmpc.filter import AdaptiveFilter
from positioner.laws.nmpc.lagged.pipeline import pipeline_at
from positioner.laws.nmpc.lagged.slip import Slip
from positioner.laws.nmpc.lagged.valve import is_lagged, lagged_valve
from positioner.values import replace
from positioner.valve.motion import Load, MotionModel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from positioner.config.schema import Configuration
    from positioner.laws.nmpc.lagged.drive import Drive
    from positioner.valve.stiction import StictionTable

    Array = NDArray[np.float64]

_LAGS_BEFORE = 12.0
"""So many lags before a window the pressure is taken to be the current."""


@dataclass(frozen=True, slots=True)
class Believed:
    """What the law knows of the valve: a slip of its stem opening, its drive, and the dead time in s.

    shift_s: by how much later than a reading an estimate is: the instant at which commands act, without a lag.
    """

    slip: Slip
    drive: Drive
    dead_time_s: float
    shift_s: float
    period_s: float

    def path_m(
        self, estimate: tuple[Array, Array], slides: NDArray[np.bool_], current_ma: Array, first: int, last: int
    ) -> Array:
        """Return the predicted positions of the samples from `first` to `last`, NaN before the first slide in them.

        Args:
            estimate: the law's position in m and speed in m/s of each sample.
            slides: whether the law believes that the stem slides; each edge begins a prediction.
            current_ma: the commands, which act from their sample on.
            first: the first sample of interest.
            last: the last one.
        """
        found = np.full(last + 1 - first, np.nan)
        begins = first + np.flatnonzero(slides[first + 1 : last + 1] & ~slides[first:last])
        if not len(begins):
            return found
        lag_s = self.drive.fill_s + self.drive.vent_s + self.drive.converter_s + self.dead_time_s
        since = max(int(begins[0]) - int(_LAGS_BEFORE * lag_s / self.period_s) - 1, 0)
        pipeline = pipeline_at(float(current_ma[since]), 0.0, self.dead_time_s, self.period_s)
        x, v, slip, stopped = np.nan, 0.0, self.slip, True
        starts = {int(each) + (0 if self.is_immediate else 1) for each in begins}
        for sample in range(since, last + 1):
            if sample in starts:
                x, v, stopped = float(estimate[0][sample]), float(estimate[1][sample]), False
                later = float(estimate[1][min(sample + 1, last)]) or v
                slip = replace(slip, direction=1.0 if later >= 0.0 else -1.0)
            if sample >= first:
                found[sample - first] = x
            before, pipeline = pipeline, pipeline.after(self.drive, float(current_ma[sample]))
            if not stopped:
                x, v, _, _, stopped = slip.after(x, v, before.pressure_ma, before.converter_ma, pipeline.acting_ma)
        return found

    @property
    def is_immediate(self) -> bool:
        """Whether the stem slides from the sample on in which the law begins to push."""
        return self.drive.fill_s == 0.0 and self.dead_time_s == 0.0


def believed(configuration: Configuration, table: StictionTable) -> Believed:
    """Return what the law knows of the valve with this table."""
    valve, control, guard = configuration.valve, configuration.control, configuration.guard
    delay_s, period_s = control.command_delay_s, control.sample_period_s
    own = lagged_valve(
        control.nmpc.lagged, valve, period_s, delay_s, guard.current_low_ma, guard.current_high_ma
    )  # fmt: skip
    sliding_n = min(own.sliding_n, own.static_n)
    slip, drive = Slip(own.model, own.drive, 1.0, own.spring_n_per_m, own.static_n, sliding_n), own.drive
    lagged = is_lagged(valve)
    if table.fit is not None:
        # a fit that an earlier version has kept may have a lag that is not configured
        lagged = lagged or table.fit.fill_s > 0.0
        drive = drive.with_lags(table.fit.fill_s, table.fit.vent_s)
        slip = Slip(own.model, drive, 1.0, table.fit.spring_n_per_m, table.fit.static_n, table.fit.sliding_n)
    elif not lagged and valve.coulomb_friction_n > 0.0:
        nominal, ratio = Load.of(valve), valve.static_friction_n / valve.coulomb_friction_n
        sigmas = AdaptiveFilter(control.nmpc.adaptation, MotionModel.of(valve), nominal).prior_sigmas()
        load, _ = load_from_table(
            control.nmpc.breakaway, MotionModel.of(valve), table, nominal, sigmas, ratio
        )  # fmt: skip
        slip = Slip(own.model, drive, 1.0, load.spring_n_per_m, ratio * load.friction_n, load.friction_n)
    return Believed(
        slip, drive, own.dead_time_s if lagged else 0.0, 0.0 if lagged else delay_s, period_s
    )  # fmt: skip
