"""A move to be planned, and the limits of its inputs. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.values import dataclass
from positioner.valve.slide import slide_of

if TYPE_CHECKING:
    from positioner.laws.nmpc.filter import Sliding
    from positioner.laws.nmpc.settings import NmpcSettings
    from positioner.valve.motion import Load, MotionModel
    from positioner.valve.slide import Slide


@dataclass(frozen=True, slots=True)
class Limits:
    """The limits of the inputs (H_u) in mA, for a move in `direction` (±1).

    braking, driving: the inputs that brake and that drive the most; low and high are the same two, the smaller one
    first. brake_ma: the current that the stem is to stop under.
    """

    direction: float
    braking: list[float]
    driving: list[float]
    low: list[float]
    high: list[float]
    brake_ma: float

    def cut(self, inputs_ma: list[float]) -> list[float]:
        """Return `inputs_ma` inside the limits."""
        low, high = self.low, self.high
        return [min(max(inputs_ma[i], low[i]), high[i]) for i in range(len(inputs_ma))]


@dataclass(frozen=True, slots=True)
class Move:
    """A move to be planned: from x (m) and v (m/s) in `direction` (±1) to the target, against `load`.

    brake_ma: the current that the stem is to stop under, in the stick band of the target.
    weakest_ma, strongest_ma: the least and the most current, seen in the direction of the move.
    release_ma: the least current of the first step, Γ for a stem that still sticks (eqs 25, 26), else `weakest_ma`.
    """

    x: float
    v: float
    direction: float
    target_m: float
    load: Load
    brake_ma: float
    weakest_ma: float
    strongest_ma: float
    release_ma: float

    def slide(self, model: MotionModel, period_s: float) -> Slide:
        """Return the constants of the slide that the move is."""
        return slide_of(model, self.load, self.direction, period_s, self.brake_ma)

    def limits(self, count: int) -> Limits:
        """Return the limits of `count` inputs; the first one starts at `release_ma`."""
        braking, driving = [self.weakest_ma] * count, [self.strongest_ma] * count
        braking[0] = self.release_ma
        low, high = (braking, driving) if self.direction > 0.0 else (driving, braking)
        return Limits(self.direction, braking, driving, low, high, self.brake_ma)

    def smallest_m(self, slide: Slide) -> float:
        """Return where in m the stem stops after the smallest push: one sample of the least current, then braking."""
        x, v = slide.after(self.x, self.v, self.release_ma)
        return slide.stop(x, v)[0]


def move_of(
    settings: NmpcSettings,
    model: MotionModel,
    here: Sliding,
    aim_m: float,
    static_n: float,
    limits_ma: tuple[float, float],
    release_ma: float | None,
) -> Move:
    """Return the move from `here` to the aim, with currents inside `limits_ma`, against the static friction `static_n`.

    `release_ma` is Γ while the stem still sticks. An aim that lies behind the stem by now is for the next move: this
    one stops where it can.
    """
    s, load, (low_ma, high_ma) = here.direction, here.load, limits_ma
    target_m = aim_m if s * (aim_m - here.x) > 0.0 else here.x
    middle_n = load.spring_n_per_m * target_m
    brake_ma = model.current_ma(middle_n - s * settings.brake_share * static_n)
    weakest_ma = min(max(model.current_ma(middle_n - s * settings.brake_limit * load.friction_n), low_ma), high_ma)
    return Move(
        x=here.x,
        v=here.v,
        direction=s,
        target_m=target_m,
        load=load,
        brake_ma=min(max(brake_ma, low_ma), high_ma),
        weakest_ma=weakest_ma,
        strongest_ma=high_ma if s > 0.0 else low_ma,
        release_ma=weakest_ma if release_ma is None else s * max(s * release_ma, s * weakest_ma),
    )
