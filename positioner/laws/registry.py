"""Every control law by name. Pure, but for the solvers that it makes, and the code of laws from outside.

A new law of this package is one file and one entry here. Others have the name of an entry point, or FILE.py:NAME.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from positioner.errors import ConfigurationError, Problem
from positioner.inputs.plug_in import (
    Kind,
    file_and_name,
    installed,
    is_interrupt,
    line_in,
    loaded,
    problem_of,
    text_of_error,
)
from positioner.laws.nmpc.factory import nmpc_law
from positioner.laws.nmpc.programme import KNOTS
from positioner.laws.outside import OutsideLaw
from positioner.laws.paper.law import PaperLaw
from positioner.laws.rivals.knocker import Knocker, KnockerMemory
from positioner.laws.rivals.pi import NoCompensator, PiLaw
from positioner.laws.rivals.pid import PidController
from positioner.laws.rivals.reinforcement import Reinforcement
from positioner.laws.rivals.two_move import TwoMoveLaw
from positioner.values import replace

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from positioner.guard.settings import GuardSettings
    from positioner.laws.estimator_settings import EstimatorSettings
    from positioner.laws.law import Law
    from positioner.laws.nmpc.law import NmpcLaw
    from positioner.laws.rivals.pid import PidSettings
    from positioner.laws.settings import ControlSettings
    from positioner.optimization.qp import Solver
    from positioner.valve.parameters import ValveParameters


@dataclass(frozen=True, slots=True)
class Ingredients:
    """The settings of a law, and `make_solver(inputs, steps)`, which returns a workspace for horizons of that size."""

    control: ControlSettings
    valve: ValveParameters
    estimator: EstimatorSettings
    guard: GuardSettings
    make_solver: Callable[[int, int], Solver]


def _paper(name: str, parts: Ingredients, *, use_table: bool) -> PaperLaw:
    planner = parts.control.planner
    return PaperLaw(
        name=name,
        valve=parts.valve,
        planner=planner,
        estimator=parts.estimator,
        bounds=parts.control.bounds,
        solver=parts.make_solver(planner.control_steps, planner.prediction_steps),
        current_low_ma=parts.guard.current_low_ma,
        current_high_ma=parts.guard.current_high_ma,
        period_s=parts.control.sample_period_s,
        use_table=use_table,
        table_from_s=parts.control.table_from_s,
    )


def _controller(pid: PidSettings, parts: Ingredients) -> PidController:
    return PidController(pid, parts.guard.current_low_ma, parts.guard.current_high_ma)


def _pi(parts: Ingredients) -> PiLaw[None]:
    return PiLaw("pi", parts.valve, _controller(parts.control.pi, parts), NoCompensator())


def _pi_deadband(parts: Ingredients) -> PiLaw[None]:
    settings = parts.control.pi_deadband
    return PiLaw("pi-deadband", parts.valve, _controller(settings.pid, parts), NoCompensator(), settings.deadband_m)


def _knocker(parts: Ingredients) -> PiLaw[KnockerMemory]:
    settings = parts.control.knocker
    return PiLaw("knocker", parts.valve, _controller(settings.pid, parts), Knocker(settings))


def _constant_reinforcement(parts: Ingredients) -> PiLaw[float]:
    settings = parts.control.constant_reinforcement
    return PiLaw("constant-reinforcement", parts.valve, _controller(settings.pid, parts), Reinforcement(settings))


def _two_move(name: str, parts: Ingredients, *, retries: bool) -> TwoMoveLaw:
    retry = parts.control.two_move_retry if retries else None
    moves = retry.moves if retry else parts.control.two_move
    return TwoMoveLaw(name, parts.valve, moves, retry, parts.guard.current_low_ma, parts.guard.current_high_ma)


def _nmpc(name: str, parts: Ingredients, *, brakes: bool) -> NmpcLaw:
    control, guard = parts.control, parts.guard
    law = nmpc_law(
        parts.valve,
        parts.estimator,
        (guard.current_low_ma, guard.current_high_ma),
        control.sample_period_s,
        control.command_delay_s,
        solver=parts.make_solver(KNOTS, KNOTS) if brakes else None,
        rate_ma_per_s=guard.max_rate_ma_per_s or math.inf,
    )
    return replace(law, name=name, table_from_s=control.table_from_s)


LAWS: Mapping[str, tuple[str, Callable[[Ingredients], Law[Any]]]] = MappingProxyType(
    {
        "nmpc": (
            "moves that a quadratic programme stops at the setpoint, quasi-static ones until the valve is known",
            lambda parts: _nmpc("nmpc", parts, brakes=True),
        ),
        "quasi-static": (
            "moves that end where spring and friction balance the pressure; each rest teaches both",
            lambda parts: _nmpc("quasi-static", parts, brakes=False),
        ),
        "paper": (
            "the paper's NMPC with movable speed bound and breakaway bound from the stiction table",
            lambda parts: _paper("paper", parts, use_table=True),
        ),
        "paper-plain": (
            "the paper's NMPC without the table",
            lambda parts: _paper("paper-plain", parts, use_table=False),
        ),
        "pi": ("PI with filtered derivative and anti-windup", _pi),
        "pi-deadband": ("PI that freezes its current while the error is small", _pi_deadband),
        "knocker": ("PI and pulses in the direction in which its output changes (Hägglund 2002)", _knocker),
        "constant-reinforcement": (
            "PI and a constant push in the direction in which its output changes (Ivan and Lakshminarayanan 2009)",
            _constant_reinforcement,
        ),
        "two-move": (
            "two moves to the setpoint, in open loop (Srinivasan and Rengaswamy 2008)",
            lambda parts: _two_move("two-move", parts, retries=False),
        ),
        "two-move-retry": (
            "two moves to the setpoint, made again where the stem came to rest too far from it",
            lambda parts: _two_move("two-move-retry", parts, retries=True),
        ),
    }
)
"""By name: a description, and the function that makes the law."""


def law_names() -> tuple[str, ...]:
    """Return the names of all laws that need no file: those of this package, then those that others have installed."""
    return tuple(dict.fromkeys((*LAWS, *installed(Kind.LAW))))


def is_outside(name: str) -> bool:
    """Whether a law of this name is from outside of this package."""
    return name not in LAWS


def law_problem(name: str, known: tuple[str, ...] = tuple(LAWS), unknown: str = "is unknown") -> str | None:
    """Return what is wrong with the name of a law, None where it is one of `known` or from outside; no code runs.

    unknown: what is said of a name that no law has.
    """
    return None if name in known else problem_of(Kind.LAW, name, known, unknown)


def make_law(name: str, parts: Ingredients) -> Law[Any]:
    """Return a new instance of the law `name`.

    Raises:
        ConfigurationError: a law from outside cannot be loaded or made.
    """
    if not is_outside(name):
        _, make = LAWS[name]
        return make(parts)
    found = file_and_name(name)
    return outside_law(found.label if found else name, loaded(Kind.LAW, name), parts)


def outside_law(label: str, make: Callable[..., Any], parts: Ingredients) -> OutsideLaw:
    """Return the law that `make`, a class or function from outside, makes of `parts` and `control.parameters`.

    Raises:
        ConfigurationError: it raises an error, or what it makes has no `begin` or `decide`.
    """
    module = sys.modules.get(getattr(make, "__module__", ""))
    file = getattr(module, "__file__", None) or ""
    try:
        own = make(parts, **parts.control.parameters)
    except BaseException as error:  # code of others may raise anything
        if is_interrupt(error):
            raise
        line = line_in(error, Path(file))
        problem = Problem("law", line, f"cannot be made: {text_of_error(error)}")
        raise ConfigurationError(label, (problem,)) from error
    if lacks := [name for name in ("begin", "decide") if not callable(getattr(own, name, None))]:
        message = f"has no {' and no '.join(lacks)}: docs/own-law.md shows what a law is"
        raise ConfigurationError(label, (Problem("law", None, message),))
    return OutsideLaw(label, own, file, parts.guard.current_low_ma, parts.guard.current_high_ma)
