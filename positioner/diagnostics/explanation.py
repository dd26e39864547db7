"""Why each command was what it was: mode, motion, active bound, Γ, fallback, and where the move landed. Pure.

An `Explainer` reads the events of every cycle in their order, live or from a replay. It explains commands from the
decision that the law gave, and computes nothing anew.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING

from positioner.cycle.events import Controlled, LawFellBack, ModeChanged, MoveBegan
from positioner.wire.messages import Cause, Mode, Motion

if TYPE_CHECKING:
    from collections.abc import Sequence

    from positioner.cycle.events import Event
    from positioner.laws.law import Decision
    from positioner.laws.move_reason import MoveReason


class ActiveBound(StrEnum):
    """The bound that a command meets; the value is its name in texts."""

    REST = "at rest"
    """No bound: the stem rests, and the current is in the middle of its stick band."""
    GUARD = "limit of the guard"
    """The guard admitted another current than the law wanted."""
    BREAKAWAY = "breakaway current"
    """The least push that frees a stuck stem, or brakes a sliding one least: Γ (paper eqs 25, 26)."""
    CURRENT = "current limit"
    """The strongest current that the loop may give."""
    SPEED = "speed bound"
    """The movable bound of the speed, above which friction could not stop the stem at the setpoint."""
    NONE = "none"
    """The plan lies inside all bounds."""


def active_bound(decision: Decision, admitted_ma: float, velocity_m_per_s: float, direction: float) -> ActiveBound:
    """Return the bound that a command meets.

    Args:
        decision: what the law decided, with the bounds in force.
        admitted_ma: what the guard sent, in mA.
        velocity_m_per_s: estimated speed of the stem.
        direction: of its move, ±1.
    """
    wanted_ma, bounds = decision.current_ma, decision.bounds
    if abs(admitted_ma - wanted_ma) > _SAME_MA:
        return ActiveBound.GUARD
    if decision.motion is not Motion.MOVE:
        return ActiveBound.REST
    ends_ma = bounds.current_low_ma, bounds.current_high_ma
    weakest_ma, strongest_ma = ends_ma if direction > 0.0 else ends_ma[::-1]
    if abs(wanted_ma - strongest_ma) <= _SAME_MA:
        return ActiveBound.CURRENT
    if abs(wanted_ma - weakest_ma) <= _SAME_MA:
        return ActiveBound.BREAKAWAY
    limit_m_per_s = bounds.speed_high_m_per_s if direction > 0.0 else bounds.speed_low_m_per_s
    if limit_m_per_s and velocity_m_per_s / limit_m_per_s >= _NEAR_SPEED:
        return ActiveBound.SPEED
    return ActiveBound.NONE


@dataclass(slots=True)
class ExplainedMove:
    """One move: why it began, what it was to do, and where it ended; positions in m, instants in s of the log.

    ended_s: when the stem had stopped, by the model; None while it moves.
    landed_m: the best estimate of the place where it stopped, until the next move.
    low_ma, high_ma: the range of the currents in the move.
    """

    number: int
    begun_s: float
    origin_m: float
    setpoint_m: float
    reason: MoveReason
    ended_s: float | None = None
    landed_m: float | None = None
    low_ma: float = 0.0
    high_ma: float = 0.0
    fallbacks: list[str] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class ExplainedCommand:
    """One command: what it was, and why; None where the law did not decide it, or no move had begun.

    time_s: instant in s of the log; bound: None without a law.
    """

    time_s: float
    current_ma: float
    mode: Mode
    cause: Cause
    controlled: Controlled | None = None
    bound: ActiveBound | None = None
    move: ExplainedMove | None = None
    fallback: str = ""


@dataclass(slots=True)
class Explainer:
    """Explains the cycles that are given to `add`; keeps every move, and counts commands by what they met."""

    moves: list[ExplainedMove] = field(default_factory=list)
    counts: Counter[str] = field(default_factory=Counter)
    _cause: Cause = Cause.NONE

    def add(self, time_s: float, mode: Mode, events: Sequence[Event], sent_ma: float | None) -> ExplainedCommand | None:
        """Return the explanation of the cycle's command, None without one.

        Args:
            time_s: instant of the cycle in the log.
            mode: of the guard, at the end of the cycle.
            events: of the cycle.
            sent_ma: current of its command, None where none was sent.
        """
        controlled, began, fallback = None, None, ""
        for event in events:
            if isinstance(event, ModeChanged):
                self._cause = event.cause
            elif isinstance(event, MoveBegan):
                began = event.reason
            elif isinstance(event, LawFellBack):
                fallback = event.why
            elif isinstance(event, Controlled):
                controlled = event
        move = self._followed(time_s, controlled, began, fallback) if controlled else None
        if sent_ma is None:
            return None
        bound = None
        if controlled:
            stem = controlled.stem
            direction = _direction(move, stem.direction)
            bound = active_bound(controlled.decision, controlled.current_ma, stem.velocity_m_per_s, direction)
        self.counts[bound.value if bound else f"mode {mode.name}"] += 1
        return ExplainedCommand(time_s, sent_ma, mode, self._cause, controlled, bound, move, fallback)

    def _followed(
        self, time_s: float, controlled: Controlled, began: MoveReason | None, fallback: str
    ) -> ExplainedMove | None:
        """Return the move that is under way or was the last one, brought up to this cycle."""
        stem, current_ma = controlled.stem, controlled.current_ma
        if began:
            number = len(self.moves) + 1
            self.moves.append(
                ExplainedMove(
                    number, time_s, stem.position_m, controlled.setpoint_m, began, low_ma=current_ma, high_ma=current_ma
                )
            )
        move = self.moves[-1] if self.moves else None
        if move is None:
            return None
        if fallback:
            move.fallbacks.append(fallback)
        if controlled.decision.motion is Motion.MOVE and move.ended_s is None:
            move.low_ma, move.high_ma = min(move.low_ma, current_ma), max(move.high_ma, current_ma)
        else:
            move.ended_s = time_s if move.ended_s is None else move.ended_s
            move.landed_m = stem.position_m
        return move


def _direction(move: ExplainedMove | None, otherwise: float) -> float:
    """Return the direction of the move, ±1."""
    if move is None:
        return otherwise
    return 1.0 if move.reason.aim_m >= move.origin_m else -1.0


_SAME_MA = 0.0005
"""Half a bit of the command frame: currents that differ by less are the same."""
_NEAR_SPEED = 0.95
"""A stem that is so near to the speed bound, as a part of it, meets it."""
