"""One observed cycle: all that health is computed from, live and from a log. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from positioner.cycle.events import Controlled, Event
from positioner.values import dataclass

if TYPE_CHECKING:
    from positioner.cycle.hunting import Hunting
    from positioner.cycle.input import CycleInput
    from positioner.cycle.state import CycleState
    from positioner.valve.state import StemState
    from positioner.wire.messages import CanFrame, Cause, Mode

_NS_PER_US: Final = 1000


@dataclass(frozen=True, slots=True)
class ObservedCycle:
    """What one cycle received, did and reported.

    now_us: its instant in µs of a monotonic clock, as the record holds it.
    mode, cause: of the guard, after the cycle.
    position_m: the plausible reading that came in it, None where none came. pressure_pa: the newest one, None without a
        sensor. applied_ma: the current that acted on the stem, None where unknown.
    controlled: the closed cycle with setpoint, estimate and current, None where no law has decided.
    events: all that it reported. hunting: the swings of the stem under the law, None while it does not control.
    """

    now_us: int
    mode: Mode
    cause: Cause
    position_m: float | None
    pressure_pa: float | None
    applied_ma: float | None
    controlled: Controlled | None
    events: tuple[Event, ...]
    hunting: Hunting | None = None

    @property
    def stem(self) -> StemState | None:
        """The law's estimate of the stem, None where no law has decided."""
        return None if self.controlled is None else self.controlled.stem


def observed_cycle(
    cycle_input: CycleInput,
    before: CycleState,
    after: CycleState,
    outbox: tuple[CanFrame, ...],
    events: tuple[Event, ...],
) -> ObservedCycle | None:
    """Return what the cycle shows that `step` brought from `before` to `after`; None where only time passed.

    A cycle without frames and events is in no record, so it must not count either.
    """
    if not cycle_input.frames and not outbox and not events:
        return None
    controlled: Controlled | None = None
    for event in events:
        if isinstance(event, Controlled):
            controlled = event
    guard, read_ns = after.guard, after.guard.last.feedback_ns
    is_read = read_ns is not None and read_ns != before.guard.last.feedback_ns
    return ObservedCycle(
        cycle_input.now_ns // _NS_PER_US,
        guard.mode,
        guard.cause,
        after.link.feedback.readings.position_m if is_read else None,
        after.link.pressure_pa,
        after.effect.current_ma,
        controlled,
        events,
        after.hunting,
    )
