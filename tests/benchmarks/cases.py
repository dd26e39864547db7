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
from benchmarks.plans import PlanCase, recorded_programs
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
LAGGED = "1 kHz with a lag of 50 ms"
"""The condition of the cycles on a valve whose actuator lags."""
PEERS: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        "qpmpc + daqp": ("peer_qpmpc", "with_daqp"),
        "qpmpc + OSQP": ("peer_qpmpc", "with_osqp"),
        "CasADi qpOASES": ("peer_casadi", "Qpoases"),
        "CasADi Opti + IPOPT": ("peer_casadi", "OptiIpopt"),
        "do-mpc": ("peer_do_mpc", "DoMpc"),
    }
)
"""Module and maker of each other program."""


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
    found["plan, ours"] = Entry(PlanCase)
    for name in PEERS:
        found[f"plan, {name}"] = Entry(partial(_peer, name), foreign=True)
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


def _cycles(period_s: float, setpoints: int, dwell_s: float, seed: int, lag_s: float = 0.0) -> Case:
    return CycleCase(scenario(period_s, setpoints, dwell_s, seed, lag_s))


def _bus(kind: str, *, paired: bool) -> Case:
    return BusCase(scenario(1e-3, 20, 0.04, 1), kind, paired=paired)


def _peer(name: str) -> Case:
    module, maker = PEERS[name]
    problems = [control_problem(program) for program in recorded_programs()]
    # only the one worker that measures them needs the other programs
    return PeerCase(getattr(import_module(f"benchmarks.{module}"), maker), problems)
