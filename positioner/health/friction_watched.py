"""What the trend of friction and spring gives to the alarms: the value of each cause. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.health.alarms import Watched
from positioner.health.causes import AlarmCause

if TYPE_CHECKING:
    from positioner.health.friction_trend import Changes, FrictionTrend


def friction_watched(found: Changes, trend: FrictionTrend) -> list[Watched]:
    """Return the values of friction and spring; friction that one direction alone shows is none."""
    moves = f"{trend.moves} moves, {trend.moves_up} of them opening"
    friction, what = found.friction, "sliding friction"
    if found.static is not None and abs(found.static.value) > abs(friction.value):
        friction, what = found.static, "static friction"
    apart = 0.0 if found.one_sided else friction.value
    text = f"{what} in {moves}"
    common = abs(found.friction.value) if found.one_sided else 0.0
    watched = [
        Watched(AlarmCause.FRICTION_HIGH, apart, friction.sigma, text),
        Watched(AlarmCause.FRICTION_LOW, -apart, friction.sigma, text),
        Watched(
            AlarmCause.SPRING_RATE, abs(found.spring.value), found.spring.sigma, _signed(found.spring.value, moves)
        ),
        Watched(
            AlarmCause.SPRING_FORCE, abs(found.offset.value), found.offset.sigma, _signed(found.offset.value, moves)
        ),
        Watched(AlarmCause.ONE_SIDED, 2.0 * common, 2.0 * friction.sigma, moves),
    ]
    if found.jump is not None:
        watched.append(Watched(AlarmCause.SLIP_JUMP, found.jump.value, found.jump.sigma, moves))
    return watched


def _signed(value: float, moves: str) -> str:
    return f"{'higher' if value > 0.0 else 'lower'} than the reference, in {moves}"
