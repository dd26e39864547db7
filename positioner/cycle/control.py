"""The law's part of a cycle: estimate, detect, learn, decide. A law that raises has decided nothing. Pure."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from positioner.cycle.events import Event, LawFellBack, MoveBegan
from positioner.cycle.handover import start_m
from positioner.cycle.learning import believe, learn
from positioner.cycle.trust_events import PushFailed
from positioner.laws.law import Decision, Observation

if TYPE_CHECKING:
    from positioner.cycle.link import Reading
    from positioner.cycle.state import CycleState, Setup


def control(
    setup: Setup, state: CycleState, reading: Reading, events: list[Event]
) -> tuple[CycleState, Decision | None]:
    """Return the state after estimate, learning and decision. A law that raises has decided nothing."""
    state = believe(setup, state, events)
    try:
        if state.memory is None:
            # control begins: hold what is there until the host asks for something else
            here = min(
                max(start_m(state.handover, reading.position_m), setup.valve.travel_min_m), setup.valve.travel_max_m
            )
            state = replace(state, memory=setup.law.begin(reading.position_m), stem=None, setpoint_m=here)
        asked_m = state.link.setpoint_m if state.handover is None else None
        setpoint_m = asked_m if asked_m is not None else state.setpoint_m
        elapsed_s = reading.periods * setup.period_s
        observation = Observation(
            reading.position_m,
            _applied_ma(setup, state, reading),
            elapsed_s,
            setpoint_m,
            state.control_s,
            state.link.pressure_pa,
        )
        memory, estimate = setup.law.estimate(state.memory, observation)
        state = learn(setup, state, estimate.lessons, events)
        memory, decision = setup.law.decide(memory, estimate.stem, observation, state.table)
        _check(decision)
    except Exception as error:  # noqa: BLE001 - whatever a law does, the valve gets a command that somebody chose
        watch = replace(state.guard, law_failures=state.guard.law_failures + 1)
        events.append(LawFellBack(f"{setup.law.name} failed: {type(error).__name__}: {error}"))
        return replace(state, guard=watch, memory=None, stem=None), None
    if decision.reason:
        events.append(MoveBegan(decision.reason))
    if decision.failed_pushes:
        events.append(PushFailed(decision.failed_pushes, decision.rest_s))
    if decision.fallback:
        events.append(LawFellBack(decision.fallback))
    state = replace(
        state,
        memory=memory,
        stem=estimate.stem,
        setpoint_m=setpoint_m,
        control_s=state.control_s + elapsed_s,
        guard=replace(state.guard, law_failures=0) if state.guard.law_failures else state.guard,
        answered=True,
    )
    return state, decision


def _check(decision: Decision) -> None:
    """Raise ValueError where a law's answer is no current: it then counts as a failure of the law."""
    if not math.isfinite(decision.current_ma):
        raise ValueError(f"a current of {decision.current_ma} mA")


def _applied_ma(setup: Setup, state: CycleState, reading: Reading) -> float:
    """Return the current that acted before the reading; before the first command, the one that balances the spring."""
    acting_ma = state.effect.current_ma
    return acting_ma if acting_ma is not None else setup.valve.balance_current_ma(reading.position_m)
