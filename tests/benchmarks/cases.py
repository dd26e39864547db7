"""Every case of the benchmark by name; a name says what is measured and under which conditions."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from importlib import import_module
from types import MappingProxyType
from typing import TYPE_CHECKING

from benchmarks.bus_latency import BusCase
from benchmarks.cycles import CycleCase, scenario
from benchmarks.peers import PeerCase
from benchmarks.plans import PERIOD_S, PlanCase, one_pass, recorded_plans
from benchmarks.problem import control_problem
from benchmarks.simulation import SimulationCase
from benchmarks.valves import COUNTS, ValvesCase

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from benchmarks.case import Case

ROUNDS = 20
"""Repeats of a case. The smallest duration of an action is what it takes; the rest is other people's noise."""
_FEW = 5
"""Repeats of what takes long, or has no smallest duration that would mean much."""
PLAN_HORIZONS = (4, 20)
"""H_p = H_u of the plans that are compared with those of other programs."""
HORIZONS = (4, 10, 20, 50)
"""H_p = H_u of the cycles that are compared with each other."""
LAGGED = "1 kHz with a lag of 50 ms"
"""The condition of the cycles on a valve whose actuator lags."""
PEERS: Mapping[str, tuple[str, str, float]] = MappingProxyType(
    {
        "qpmpc + daqp": ("peer_qpmpc", "with_daqp", 1e-5),
        "qpmpc + OSQP": ("peer_qpmpc", "with_osqp", 1e-5),
        "CasADi sqpmethod + qrqp": ("peer_casadi", "Sqp", 1.0),
        "CasADi Opti + IPOPT": ("peer_casadi", "OptiIpopt", 1.0),
        "do-mpc": ("peer_do_mpc", "DoMpc", 1.0),
    }
)
"""Module and maker of each other program, and the scale of speeds: qpmpc weights all states, so they must be small."""


@dataclass(frozen=True, slots=True)
class Entry:
    """A case that can be made, how often it is repeated, and whether it has nothing to do with our build."""

    make: Callable[[], Case]
    rounds: int = ROUNDS
    foreign: bool = False


def cases() -> Mapping[str, Entry]:
    """Return all cases."""
    found: dict[str, Entry] = {}
    for seed in (1, 2):
        found[f"cycle, 1 kHz, seed {seed}"] = Entry(partial(_cycles, 1e-3, 40, 0.05, seed))
    found["cycle, 10 kHz, seed 1"] = Entry(partial(_cycles, 1e-4, 10, 0.03, 1))
    found[f"cycle, {LAGGED}, seed 1"] = Entry(partial(_cycles, 1e-3, 8, 0.25, 1, lag_s=0.05), _FEW)
    for horizon in HORIZONS:
        found[f"horizon, {horizon}"] = Entry(partial(_cycles, 1e-3, 12, 0.04, 1, horizon))
    for horizon in PLAN_HORIZONS:
        found[f"plan, {horizon}, ours"] = Entry(partial(PlanCase, horizon))
        for name in PEERS:
            found[f"plan, {horizon}, {name}"] = Entry(partial(_peer, name, horizon), foreign=True)
    for bus in ("sockets", "embedded"):
        for kind in ("echo", "daemon"):
            found[f"bus, {bus}, {kind}"] = Entry(
                partial(_bus, kind, paired=bus == "sockets"), _FEW, foreign=kind == "echo"
            )
    for count in COUNTS:
        found[f"valves, {count}"] = Entry(partial(ValvesCase, count), _FEW)
    for name in ("frames", "direct"):
        found[f"simulation, {name}"] = Entry(partial(SimulationCase, frames=name == "frames"), _FEW)
    return found


def _cycles(period_s: float, setpoints: int, dwell_s: float, seed: int, horizon: int = 4, lag_s: float = 0.0) -> Case:
    return CycleCase(scenario(period_s, setpoints, dwell_s, seed, horizon, lag_s))


def _bus(kind: str, *, paired: bool) -> Case:
    return BusCase(scenario(1e-3, 20, 0.04, 1), kind, paired=paired)


def _peer(name: str, horizon: int) -> Case:
    law, planned = recorded_plans(horizon)
    settings, model = one_pass(law), law.filter.model
    module, maker, speed_scale = PEERS[name]
    problems = [control_problem(settings, model, each, PERIOD_S).with_speed(speed_scale) for each in planned]
    # only the one worker that measures them needs the other programs
    return PeerCase(getattr(import_module(f"benchmarks.{module}"), maker), problems)
