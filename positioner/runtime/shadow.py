"""A second law beside the acting one on a live valve: it sees the same frames, and nothing of it is sent. Shell.

After each cycle of the acting law the same `step` is played again with the other law, from the same state: only what
belongs to a law (its memory, its table, what it says of the valve) is the shadow's own. So it sees the readings, and
the currents that really moved the valve. A push of its own that the acting law does not make is never made.

It changes no command: an error in it ends the shadow with one line of the log.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import TYPE_CHECKING

from positioner.cycle.events import Controlled, LawFellBack, MoveBegan
from positioner.cycle.state import ControlState
from positioner.cycle.step import step
from positioner.values import replace

if TYPE_CHECKING:
    from positioner.cycle.events import Event
    from positioner.cycle.input import CycleInput
    from positioner.cycle.state import CycleState, Setup
    from positioner.laws.law import Law
    from positioner.machine.journal import Log

TOLD_EVERY_NS = 60_000_000_000
"""A line a minute: a person compares, and needs no row of each cycle (`positioner replay --law --out` has them)."""


@dataclass(slots=True)
class Differences:
    """How the shadow's commands differ from those of the acting law: currents in mA, of cycles in which both answered.

    largest: the difference with its sign, where the stem was in m, and where it was wanted.
    moves, shadow_moves: how often each has begun one. fallbacks: how often the shadow could not do what it wanted, and
    why it could not the last time.
    """

    cycles: int = 0
    sum_ma: float = 0.0
    largest: tuple[float, float, float] = (0.0, 0.0, 0.0)
    moves: int = 0
    shadow_moves: int = 0
    fallbacks: int = 0
    why: str = ""

    def add(self, acting: tuple[Event, ...], shadow: tuple[Event, ...]) -> None:
        """Add one cycle by the events of both."""
        self.moves += sum(isinstance(event, MoveBegan) for event in acting)
        for event in shadow:
            if isinstance(event, MoveBegan):
                self.shadow_moves += 1
            elif isinstance(event, LawFellBack):
                self.fallbacks, self.why = self.fallbacks + 1, event.why
        own, other = _controlled(acting), _controlled(shadow)
        if own is None or other is None:
            return
        difference_ma = other.current_ma - own.current_ma
        self.cycles += 1
        self.sum_ma += abs(difference_ma)
        if abs(difference_ma) > abs(self.largest[0]):
            self.largest = difference_ma, own.measured_m, own.setpoint_m

    def in_words(self) -> str:
        """Return one line for the log."""
        fallbacks = f", {self.fallbacks} fallbacks (the last: {self.why})" if self.fallbacks else ""
        moves = f"{self.shadow_moves} moves where the acting law began {self.moves}"
        text = f"{self.cycles} commands, {moves}{fallbacks}"
        if not self.largest[0]:
            return f"{text}; no current differs" if self.cycles else text
        most_ma, here_mm, wanted_mm = self.largest[0], 1e3 * self.largest[1], 1e3 * self.largest[2]
        most = f"most {most_ma:+.3f} mA, with the stem at {here_mm:.3f} mm for a setpoint of {wanted_mm:.3f} mm"
        return f"{text}; current {self.sum_ma / self.cycles:.3f} mA off in the mean, {most}"


class Shadow:
    """The shadow of one valve's law; `setup` is that of the acting one."""

    def __init__(self, setup: Setup, law: Law[object], log: Log) -> None:
        """Begin; the shadow learns into a table of its own, which nobody keeps."""
        self._setup, self._log = replace(setup, law=law), log
        self._state: CycleState | None = None
        self._ended = False
        self._due_ns: int | None = None
        self.differences = Differences()
        log.info("shadow %s: runs beside %s, and sends nothing", law.name, setup.law.name)

    def cycle(self, cycle_input: CycleInput, before: CycleState, after: CycleState, events: tuple[Event, ...]) -> None:
        """Play one cycle, which the acting law has ended `after` its frames were sent."""
        if self._ended:
            return
        try:
            self._state, _, own = step(self._setup, self._shadowed(before), cycle_input)
        except Exception as error:  # noqa: BLE001 - a defect here must never end a control loop
            self._log.error("shadow %s: ended: %s: %s", self._setup.law.name, type(error).__name__, error)
            self._ended = True
            return
        if not after.guard.controls:
            return
        self.differences.add(events, own)
        if self._due_ns is None:
            self._due_ns = cycle_input.now_ns + TOLD_EVERY_NS
        elif cycle_input.now_ns >= self._due_ns:
            self._due_ns = cycle_input.now_ns + TOLD_EVERY_NS
            self.tell()

    def tell(self) -> None:
        """Log how the shadow has differed since the last line."""
        if self.differences.cycles or self.differences.fallbacks:
            self._log.log(logging.INFO, "shadow %s: %s", self._setup.law.name, self.differences.in_words())
        self.differences = Differences()

    def _shadowed(self, before: CycleState) -> CycleState:
        """Return the state of the acting law with what belongs to the shadow in its place."""
        own = self._state
        if own is None:
            return replace(before, control=ControlState(), differs=False)
        return replace(
            before, control=own.control, table=own.table, credible_table=own.credible_table, differs=own.differs
        )


def _controlled(events: tuple[Event, ...]) -> Controlled | None:
    return next((event for event in events if isinstance(event, Controlled)), None)
