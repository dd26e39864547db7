"""The result of a step response test: rows by size, regions, dead band and resolution, what was refused. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.commissioning.step.memory import repeats_needed
from positioner.commissioning.step.response import DEAD_TIME_SIGMA, figures_of
from positioner.commissioning.step.sizes import SizeRow, Spread, regions_of, rows_of
from positioner.errors import PositionerError
from positioner.values import dataclass

if TYPE_CHECKING:
    from positioner.commissioning.step.ladder import Found, Rungs
    from positioner.commissioning.step.memory import StepMemory
    from positioner.commissioning.step.plan import Plan
    from positioner.commissioning.step.procedure import StepTest

_LONG = 0.75
"""A response is too slow for its wait where its last quarter is still on the way."""


class StepTestError(PositionerError):
    """A step response test without a result; the message gives the reason."""


@dataclass(frozen=True, slots=True)
class StepResult:
    """What the test shows.

    sigma_m: of a reading at the place of the steps; dead_time_m: the motion that ends the dead time; seen_m: the
    smallest certain difference of two rests. refused: sizes, each with the repeats that it would take.
    rung: the step of the ladders.
    """

    law: str
    plan: Plan
    period_s: float
    span_m: float
    sigma_m: float
    dead_time_m: float
    seen_m: float
    rows: tuple[SizeRow, ...]
    regions: dict[float, str]
    refused: tuple[tuple[float, int], ...]
    rungs: tuple[Rungs, ...]
    rung: float

    def band(self, name: str, direction: float) -> Spread | None:
        """Return the median of `dead_band` or `resolution` in a direction, and all that its ladders leave open.

        The median is infinite where no motion was seen; None without such a ladder.
        """
        found: list[Found] = [getattr(each, name) for each in self.rungs if each.direction == direction]
        found = [each for each in found if each is not None]
        if not found:
            return None
        middle = Spread.of([0.5 * (each.without + each.moved) for each in found])
        return Spread(middle.median, min(each.without for each in found), max(each.moved for each in found), len(found))

    @property
    def too_slow(self) -> bool:
        """Whether a response lasted so long that its final rest is none."""
        return any(row.spread("t98_s").high > _LONG * self.plan.wait_s for row in self.rows)


def result_of(memory: StepMemory, test: StepTest) -> StepResult:
    """Return what a completed test shows.

    Raises:
        StepTestError: the noise forbids every size, and no ladder was asked for.
    """
    plan, span_m = test.plan, test.limits.span_m
    needed = [(size, repeats_needed(size, memory.sigma_m, span_m)) for size in plan.sizes]
    refused = tuple((size, count) for size, count in needed if count > plan.repeats)
    if not memory.responses and not memory.rungs:
        size, count = min(refused, key=lambda each: each[1])
        raise StepTestError(
            f"step-test: the noise of {100.0 * memory.sigma_m / span_m:.3g} % of the span forbids every size: "
            f"{100.0 * size:g} % takes --repeats {count}"
        )
    dead_time_m = max(plan.observable * span_m, DEAD_TIME_SIGMA * memory.sigma_m)
    figures = [
        figures_of(each, test.period_s, memory.sigma_m, memory.seen_m, dead_time_m, span_m) for each in memory.responses
    ]
    rows = rows_of(figures)
    return StepResult(
        law=test.loop.law.name,
        plan=plan,
        period_s=test.period_s,
        span_m=span_m,
        sigma_m=memory.sigma_m,
        dead_time_m=dead_time_m,
        seen_m=memory.seen_m,
        rows=rows,
        regions=regions_of(rows) if rows else {},
        refused=refused,
        rungs=memory.rungs,
        rung=test.rung(memory) if plan.ladder else math.nan,
    )
