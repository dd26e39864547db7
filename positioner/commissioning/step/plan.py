"""What a step response test does: sizes, repeats, wait time, ladder, and the place around which it steps. Pure.

An input is a part of its range: of the span where a law pursues setpoints, of the 4 to 20 mA of the signal where the
currents themselves step.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.values import dataclass, replace

if TYPE_CHECKING:
    from positioner.commissioning.procedure import ProcedureLimits
    from positioner.valve.parameters import ValveParameters

SIZES = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1)
OPEN_SIZES = (0.01, 0.02, 0.05, 0.1, 0.2, 0.4, 0.6, 0.8)
REPEATS = 3
LADDER, OPEN_LADDER = 0.0005, 0.005
_SHORTEST_WAIT_S = 2.0
_TIME_CONSTANTS = 6.0
_APPROACH = 0.05
_FEWEST_SAMPLES = 40
_LARGEST_RUNG = 0.05
"""Ten times that is half of the range."""
_ROUNDING = 1e-9
SIGNAL_LOW_MA, SIGNAL_SPAN_MA = 4.0, 16.0


@dataclass(frozen=True, slots=True)
class Plan:
    """What the test does; inputs and steps are parts of the range of the input.

    is_open: the currents step, and no law acts. sizes: of the steps, rising. wait_s: from each step to the next.
    ladder: the step of the ladders to dead band and resolution, 0 leaves them out. place: the middle of the steps.
    low, high: the ends of what may be asked for. observable: the smallest motion that counts, a part of the span.
    """

    is_open: bool
    sizes: tuple[float, ...]
    repeats: int
    wait_s: float
    ladder: float
    place: float
    low: float
    high: float
    observable: float = 1e-4

    @classmethod
    def of(cls, valve: ValveParameters, limits: ProcedureLimits, *, is_open: bool) -> Plan:
        """Return the usual test of the configured valve within the limits."""
        low_ma, high_ma = limits.current_low_ma, limits.current_high_ma
        plan = cls(
            is_open=is_open,
            sizes=OPEN_SIZES if is_open else SIZES,
            repeats=REPEATS,
            wait_s=wait_s_of(valve),
            ladder=OPEN_LADDER if is_open else LADDER,
            place=0.5,
            low=max((low_ma - SIGNAL_LOW_MA) / SIGNAL_SPAN_MA, 0.0),
            high=min((high_ma - SIGNAL_LOW_MA) / SIGNAL_SPAN_MA, 1.0),
        )
        if is_open:
            return plan
        ends_m = valve.restartable_m(low_ma, high_ma)
        if ends_m[0] >= ends_m[1]:
            ends_m = valve.reach_m(low_ma, high_ma)
        low, high = (min(max((end_m - valve.travel_min_m) / valve.span_m, 0.0), 1.0) for end_m in ends_m)
        sizes = tuple(size for size in SIZES if size <= high - low)
        return replace(plan, sizes=sizes, place=0.5 * (low + high), low=low, high=high)

    @property
    def approach(self) -> float:
        """The way onto the place at which a ladder begins: in closed loop a step, in open loop all the range."""
        return self.high - self.low if self.is_open else min(_APPROACH, self.high - self.low)

    def problem(self, period_s: float) -> str:
        """Return why the valve cannot do this, with the option to change; empty where it can."""
        if not self.sizes or self.sizes[0] <= 0.0:
            return "--sizes must be percents above 0"
        if self.repeats < 1:
            return f"--repeats {self.repeats}: must be 1 or more"
        if not self.wait_s >= _FEWEST_SAMPLES * period_s:
            return (
                f"--wait {self.wait_s:g}: must be {_FEWEST_SAMPLES * period_s:g} s or more, {_FEWEST_SAMPLES} periods"
            )
        if not 0.0 <= self.ladder <= _LARGEST_RUNG:
            return f"--ladder {100.0 * self.ladder:g}: must be 0 to {100.0 * _LARGEST_RUNG:g} %"
        half = 0.5 * self.sizes[-1]
        if self.low - _ROUNDING <= self.place - half <= self.place + half <= self.high + _ROUNDING:
            return ""
        return (
            f"steps of {200.0 * half:g} % around {100.0 * self.place:.3g} % leave the range, {100.0 * self.low:.3g} to "
            f"{100.0 * self.high:.3g} % of {self.unit}: change --sizes or --at"
        )

    @property
    def unit(self) -> str:
        """What 100 % of the input is."""
        return "signal" if self.is_open else "span"


def wait_s_of(valve: ValveParameters) -> float:
    """Return a wait time in s in which the configured valve settles: six times its time constants, 2 s at least."""
    actuator = valve.actuator
    lag_s = actuator.slower_lag_s
    slow_s = valve.viscous_friction_n_s_per_m / valve.spring_rate_n_per_m
    return max(_TIME_CONSTANTS * (lag_s + slow_s), _SHORTEST_WAIT_S)
