"""The exact motion along given inputs, linearised at every step (steps 1 to 3 of paper §4.1). Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.values import dataclass

if TYPE_CHECKING:
    from positioner.valve.slide import Slide


@dataclass(frozen=True, slots=True)
class Trajectory:
    """The prediction along given inputs, step by step (H_p).

    positions in m; stops: the stopping points in m, and stop_x, stop_v: their derivatives to the state at their step.
    x_x, x_v, v_x, v_v: derivatives of the state after a step to the one before it; x_ma, v_ma: to the input.
    moving: the number of steps after which the stem rests to the end, at least 1. slides: whether it never stops.
    speed_limit: the speed in m/s after the first step from which the stem still stops at the target.
    """

    positions: list[float]
    stops: list[float]
    stop_x: list[float]
    stop_v: list[float]
    x_x: list[float]
    x_v: list[float]
    v_x: list[float]
    v_v: list[float]
    x_ma: list[float]
    v_ma: list[float]
    moving: int
    slides: bool
    speed_limit: float


def predict(slide: Slide, steps: int, x: float, v: float, target_m: float, inputs_ma: list[float]) -> Trajectory:
    """Return the motion over `steps` samples from x (m) and v (m/s) under `inputs_ma` (H_u), the last one held."""
    last = len(inputs_ma) - 1
    positions, stops, stop_x, stop_v = [0.0] * steps, [0.0] * steps, [0.0] * steps, [0.0] * steps
    x_x, x_v, v_x, v_v = [slide.x_x] * steps, [slide.x_v] * steps, [slide.v_x] * steps, [slide.v_v] * steps
    x_ma, v_ma = [slide.x_ma] * steps, [slide.v_ma] * steps
    moving, slides, limit = 1, True, 0.0
    for step in range(steps):
        current_ma = inputs_ma[step] if step < last else inputs_ma[last]
        before_x, before_v = x, v
        x, v = slide.after(before_x, before_v, current_ma)
        if v != 0.0:
            moving = step + 1
        elif before_v == 0.0 and x == before_x:
            # the stem rests
            slides = False
            x_x[step], x_v[step], v_x[step], v_v[step], x_ma[step], v_ma[step] = 1.0, 0.0, 0.0, 0.0, 0.0, 0.0
        else:
            # the stem stops in this step
            moving, slides = step + 1, False
            end = slide.model.step(before_x, before_v, current_ma, slide.load, slide.direction, slide.period_s)
            x_x[step], x_v[step], v_x[step], v_v[step] = end.dx_dx, end.dx_dv, 0.0, 0.0
            x_ma[step], v_ma[step] = end.dx_dq * slide.model.gain_n_per_ma, 0.0
        place_m, by_x, by_v = slide.stop(x, v)
        positions[step], stops[step], stop_x[step], stop_v[step] = x, place_m, by_x, by_v
        if step == 0:
            limit = v + (target_m - place_m) / by_v if by_v > 0.0 else v
    return Trajectory(positions, stops, stop_x, stop_v, x_x, x_v, v_x, v_v, x_ma, v_ma, moving, slides, limit)
