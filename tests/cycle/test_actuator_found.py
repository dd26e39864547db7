"""An actuator that is not as configured, seen by a whole cycle: one line, the status, and a law that starts again."""

from __future__ import annotations

from loop_helpers import Loop

from positioner.cycle.trust_events import ActuatorFound
from positioner.laws.nmpc.lagged.memory import LaggedMemory
from positioner.valve.actuator import ActuatorParameters
from positioner.wire.messages import Cause, Health, HostRequest, Mode

QUIET = {"noise_of_reading": 0.0, "noise_of_span": 0.0005}
LAG = {"fill_time_constant_s": 0.005, "vent_time_constant_s": 0.005}


def test_a_lag_that_nobody_has_told_is_reported_once_and_out_of_specification() -> None:
    plant = {"actuator": LAG, "sensor": QUIET, "valve": {"initial_position_m": 0.08}}
    loop = Loop(plant=plant, estimator=QUIET)
    loop.run(0.5, 0.08)
    for place_m in (0.073, 0.087, 0.076, 0.085):
        loop.run(0.6, place_m)

    (found,) = loop.events_of(ActuatorFound)
    assert str(found).startswith("the actuator is not as configured: the moves show a lag of about ")
    assert str(found).endswith(
        "valve.actuator says no lag; the law goes on with what they show; measure it: positioner identify"
    )
    guard = loop.state.guard
    assert (guard.mode, guard.cause) == (Mode.ACTIVE, Cause.ACTUATOR_DIFFERS)
    assert guard.health(table_saved=True) is Health.OUT_OF_SPECIFICATION

    # what was found outlives the law's memory
    loop.run(0.05, 0.085, HostRequest.DISARM)
    assert not loop.state.guard.controls
    loop.run(0.5, 0.085, HostRequest.ARM)
    assert isinstance(loop.state.control.memory.inner, LaggedMemory)
    assert len(loop.events_of(ActuatorFound)) == 1


def test_the_line_names_lag_and_dead_time_in_words() -> None:
    late, lag, none = ActuatorParameters(dead_time_s=0.002), ActuatorParameters(**LAG), ActuatorParameters()

    assert "the moves show a dead time of about 2 ms, and valve.actuator says no lag;" in str(ActuatorFound(late, none))
    assert "the moves show no lag, and valve.actuator says a lag of about 5 ms;" in str(ActuatorFound(none, lag))
