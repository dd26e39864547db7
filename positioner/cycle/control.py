"""The law's part of a cycle: estimate, detect, learn, decide. A law that raises has decided nothing. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.cycle.events import Event, LawFellBack, MoveBegan
from positioner.cycle.handover import blend, start_m
from positioner.cycle.learning import credible, learn
from positioner.cycle.state import ControlState
from positioner.cycle.trust_events import PushFailed
from positioner.laws.bounds import Bounds
from positioner.laws.law import Decision, Observation
from positioner.setpoint.path import NEW_PATH, followed
from positioner.values import replace

if TYPE_CHECKING:
    from positioner.cycle.input import CycleInput
    from positioner.cycle.link import Reading
    from positioner.cycle.state import CycleState, Setup
    from positioner.setpoint.path import SetpointPath


def control(
    setup: Setup, state: CycleState, reading: Reading, cycle_input: CycleInput, events: list[Event]
) -> Decision | None:
    """Bring the state over estimate, learning and decision, and return the decision; None where the law failed."""
    table, before = credible(setup, state, events), state.control
    try:
        if before.memory is None:
            before = _begun(setup, state, reading)
        path, setpoint_m = _pursued(setup, state, before, reading)
        observation = _observation(setup, state, reading, setpoint_m, before.time_s)
        memory, estimate = setup.law.estimate(before.memory, observation)
        if before.stem is not None:  # in the law's first cycle nothing is learned
            table = learn(setup, state, table, estimate.lessons, events)
        if path.shut:
            memory, decision = setup.law.begin(reading.position_m), _shut(setup, path.shut)
        else:
            memory, decision = setup.law.decide(memory, estimate.stem, observation, table)
        _check(decision)
    except Exception as error:  # noqa: BLE001 - a law may raise anything, and the valve still needs a command
        events.append(LawFellBack(f"{setup.law.name} failed: {type(error).__name__}: {error}"))
        state.table = state.credible_table = table
        state.guard = state.guard.after_law(answered=False)
        state.control = replace(before, memory=None, stem=None)
        return None
    state.table = state.credible_table = table
    events += _events(decision)
    state.differs = decision.differs
    handover = state.handover
    if handover is not None and state.output.last_ma is not None:
        state.handover, decision = blend(handover, decision, state.output.last_ma, cycle_input.now_ns)
    state.guard = state.guard.after_law(answered=True)
    state.control = ControlState(
        memory=memory,
        stem=estimate.stem,
        setpoint_m=observation.setpoint_m,
        time_s=before.time_s + observation.elapsed_s,
        path=path,
    )
    state.answered = True
    return decision


def _begun(setup: Setup, state: CycleState, reading: Reading) -> ControlState:
    """Return the state in which control begins: it holds the present position until the host asks for another."""
    here_m = start_m(state.handover, reading.position_m)
    setpoint_m = min(max(here_m, setup.valve.travel_min_m), setup.valve.travel_max_m)
    memory = setup.law.begin(here_m)
    return replace(state.control, memory=memory, stem=None, setpoint_m=setpoint_m, path=NEW_PATH)


def _pursued(setup: Setup, state: CycleState, before: ControlState, reading: Reading) -> tuple[SetpointPath, float]:
    """Return the path of the setpoint and the setpoint in m: the host's behind its functions, or the last one."""
    asked_m = state.link.setpoint.position_m if state.handover is None else None
    if asked_m is None:
        return before.path, before.setpoint_m
    if setup.setpoint is None:
        return before.path, asked_m
    elapsed_s = reading.periods * setup.period_s
    return followed(setup.setpoint, setup.valve, before.path, asked_m, before.setpoint_m, elapsed_s)


def _shut(setup: Setup, way: int) -> Decision:
    """Return all the current that closes (-1) or opens (+1) the valve; meanwhile no law controls it."""
    low_ma, high_ma = setup.guard.current_low_ma, setup.guard.current_high_ma
    return Decision(high_ma if way > 0 else low_ma, Bounds(0.0, 0.0, low_ma, high_ma))


def _observation(setup: Setup, state: CycleState, reading: Reading, setpoint_m: float, time_s: float) -> Observation:
    """Return the input of the law; before the first command, `applied_ma` is the current that balances the spring."""
    applied_ma = state.effect.current_ma
    return Observation(
        measured_m=reading.position_m,
        applied_ma=applied_ma if applied_ma is not None else setup.valve.balance_current_ma(reading.position_m),
        elapsed_s=reading.periods * setup.period_s,
        setpoint_m=setpoint_m,
        time_s=time_s,
        pressure_pa=state.link.pressure_pa,
        pressure_is_new=reading.pressure_is_new,
    )


def _events(decision: Decision) -> list[Event]:
    events: list[Event] = []
    if decision.reason:
        events.append(MoveBegan(decision.reason))
    if decision.failed_pushes:
        events.append(PushFailed(decision.failed_pushes, decision.rest_s))
    if decision.fallback:
        events.append(LawFellBack(decision.fallback))
    return events


def _check(decision: Decision) -> None:
    """Raise ValueError where a law's answer is no current: it then counts as a failure of the law."""
    if not math.isfinite(decision.current_ma):
        raise ValueError(f"a current of {decision.current_ma} mA")
