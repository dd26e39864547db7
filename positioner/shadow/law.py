"""A second law in the cycles of the acting one: it sees the same valve, and nothing of it is sent. Pure.

After each cycle of the acting law the same `step` is computed again with the other law, from the same state: only what
belongs to a law is the shadow's own, its memory, its table and what it says of the valve. So it sees the same reading
and setpoint, and the currents that really moved the valve; its frames, and the guard that would have limited them, are
dropped. The two are compared by the current that the guard admits.

It begins from the valve's stiction table and teaches a copy, which nobody keeps. It begins anew where the acting law
does. A push of its own that the acting law does not make is never made. Like the cycle, all is pure but for the solver
inside the law.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.cycle.events import Controlled, LawFellBack
from positioner.cycle.step import step
from positioner.shadow.differences import Differences
from positioner.shadow.sent import at_new_setpoint, with_sent
from positioner.values import replace

if TYPE_CHECKING:
    from positioner.cycle.events import Event
    from positioner.cycle.input import CycleInput
    from positioner.cycle.state import ControlState, CycleState, Setup
    from positioner.laws.law import Law

LEAST_DWELL_NS = 100_000_000
"""A setpoint that is changed sooner was passed on the way to another one: both are one dwell."""
LONGEST_MOVING_NS = 60_000_000_000
"""A dwell whose setpoint has been changed ever again for so long ends, too."""


class ShadowFailedError(Exception):
    """The law in the shadow raised an error, or answered with what is no current."""


class ShadowLaw:
    """The second law of one valve.

    name: of the law. total: all that has been compared. dwell: the present one, None before the first compared cycle.
    """

    def __init__(self, setup: Setup, law: Law[object]) -> None:
        """Begin; `setup` is that of the acting law."""
        self.name = law.name
        self.total: Differences | None = None
        self.dwell: Differences | None = None
        self._setup, self._law = replace(setup, law=law), law
        self._state: CycleState | None = None
        self._setpoint_ns = 0

    def cycle(
        self, cycle_input: CycleInput, before: CycleState, after: CycleState, events: tuple[Event, ...]
    ) -> Differences | None:
        """Compute one cycle again, which the acting law began in the state `before`; return the dwell that it ended.

        after: the state from which the next cycle begins, with what was really sent. events: of the acting law's cycle.

        Raises:
            ShadowFailedError: the law failed.
        """
        state, _, own = step(self._setup, self._shadowed(before), cycle_input)
        if not state.answered and (failed := next((each for each in own if isinstance(each, LawFellBack)), None)):
            raise ShadowFailedError(failed.why)
        ended = self._compared(cycle_input.now_ns, events, own)
        memory = state.control.memory
        if ended is not None and ended.apart:
            memory = at_new_setpoint(self._law, memory, after.link.feedback.readings.position_m)
        memory = with_sent(memory, after.output.last_ma)
        self._state = replace(state, control=replace(state.control, memory=memory))
        return ended

    def _shadowed(self, before: CycleState) -> CycleState:
        """Return the state of the acting law with what belongs to the shadow in its place."""
        own, control = self._state, before.control
        if own is None:
            return replace(before, control=_begun_anew(control), differs=False)
        if control.stem is None:  # the acting law begins in this cycle, or does not control
            control = _begun_anew(control)
        else:
            control = replace(control, memory=own.control.memory, stem=own.control.stem)
        return replace(before, control=control, table=own.table, credible_table=own.credible_table, differs=own.differs)

    def _compared(self, now_ns: int, acting: tuple[Event, ...], shadow: tuple[Event, ...]) -> Differences | None:
        """Add one cycle by the events of both; return the dwell that it ended."""
        own, other = _controlled(acting), _controlled(shadow)
        if own is None or other is None:
            return None
        ended, dwell = None, self.dwell
        if dwell is not None and dwell.setpoint_m != own.setpoint_m:
            if now_ns - self._setpoint_ns >= LEAST_DWELL_NS or now_ns - dwell.begun_ns >= LONGEST_MOVING_NS:
                ended, dwell = dwell, None
            self._setpoint_ns = now_ns
        if dwell is None:
            dwell, self._setpoint_ns = Differences(now_ns), now_ns
        if self.total is None:
            self.total = Differences(now_ns)
        self.dwell = dwell
        for each in (dwell, self.total):
            each.add(now_ns, own, other)
        return ended


def _begun_anew(control: ControlState) -> ControlState:
    return replace(control, memory=None, stem=None)


def _controlled(events: tuple[Event, ...]) -> Controlled | None:
    return next((event for event in events if isinstance(event, Controlled)), None)
