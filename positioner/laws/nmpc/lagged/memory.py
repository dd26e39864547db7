"""What the law carries from cycle to cycle on a valve with actuator lag. Pure."""

from __future__ import annotations

from dataclasses import field
from typing import TYPE_CHECKING

from positioner.laws.nmpc.sensor_noise import SensorNoise, as_configured
from positioner.laws.pushes import Pushes
from positioner.values import dataclass

if TYPE_CHECKING:
    from positioner.laws.nmpc.lagged.belief import Belief
    from positioner.laws.nmpc.lagged.drive import Drive
    from positioner.laws.nmpc.lagged.measured import MeasuredPressure
    from positioner.laws.nmpc.lagged.onset import OnsetBank
    from positioner.laws.nmpc.lagged.pipeline import Pipeline
    from positioner.laws.nmpc.lagged.regression import OnsetRegression
    from positioner.laws.nmpc.lagged.rest import LaggedRest
    from positioner.laws.nmpc.lagged.slip_filter import SlipState


@dataclass(frozen=True, slots=True)
class Move:
    """A planned move.

    origin_m: where the stem sticks. target_m: where it is to land. direction: ±1. aim_m: the target less the landing
    bias. near: whether the jump is a small one. rate_ma_per_s: of the ramp. is_final: whether it goes to the setpoint;
    else it backs off. began_s: in the law's time.
    """

    origin_m: float
    target_m: float
    direction: float
    aim_m: float
    near: bool
    rate_ma_per_s: float
    is_final: bool
    began_s: float

    @property
    def middle_m(self) -> float:
        """The middle of the way in m, where an error of K acts as one of F_c."""
        return 0.5 * (self.origin_m + self.target_m)


@dataclass(frozen=True, slots=True)
class Ramp:
    """The pressure rises until the stem slips.

    move: the move that it begins. rest: the estimate of the stem that still sticks. bank: the hypotheses of its slip.
    reference_ma: the pressure that the ramp has reached. rate_ma_per_s: of the ramp now. shift_m, slow_shift_m,
    readings: displacement from the origin, smoothed once and twice, over so many readings. peak_n: the largest force
    so far. beyond_s: for how long it has been more than should ever be needed.
    """

    move: Move
    rest: LaggedRest
    bank: OnsetBank
    reference_ma: float
    rate_ma_per_s: float
    shift_m: float = 0.0
    slow_shift_m: float = 0.0
    readings: int = 0
    peak_n: float = 0.0
    beyond_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Slipping:
    """The stem slides. static_n: the force that freed it; began_s: when; slow: samples in a row without speed."""

    move: Move
    state: SlipState
    static_n: float
    began_s: float
    slow: int = 0


@dataclass(frozen=True, slots=True)
class Attempt:
    """A move whose landing is not yet known.

    before: K, F_s and the lag without its onset. peak_n: the largest force of its ramp. spring_n_per_m: K in it.
    landing: the estimate of the slip when the model stopped it.
    """

    move: Move
    before: OnsetRegression
    peak_n: float
    spring_n_per_m: float
    landing: SlipState | None = None


@dataclass(frozen=True, slots=True)
class LaggedMemory:
    """What the law carries.

    stem: at rest, on the ramp, or sliding. pipeline: the pressure. drive: the actuator, with
    the learned lag. belief: the learned valve. noise: of the sensor.
    setpoint_m: the one that the law pursues; is_new: whether no move has been made for it; corrections: made for it.
    anchor_m: the setpoint from which it has crept here; one that creeps farther than the tolerance is a new one.
    is_final: whether the last move went to the setpoint. attempt: the last move, None once it is judged.
    hold_ma: the current at rest, None to choose one. measured: the measured pressure, None without a sensor.
    notice: what the log is to say, once.
    """

    stem: LaggedRest | Ramp | Slipping
    pipeline: Pipeline
    drive: Drive
    belief: Belief
    noise: SensorNoise = field(default_factory=as_configured)
    setpoint_m: float | None = None
    anchor_m: float = 0.0
    is_new: bool = False
    corrections: int = 0
    is_final: bool = True
    attempt: Attempt | None = None
    hold_ma: float | None = None
    pushes: Pushes = field(default_factory=Pushes)
    measured: MeasuredPressure | None = None
    notice: str = ""
