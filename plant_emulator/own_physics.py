"""A plant with its own physics: the protocol, and the calls of the code behind it, which others have written.

A plant names its physics as a plug-in, FILE.py:NAME or an entry point; so its settings are plain values that go to
other processes. The code is loaded where a plant begins, and where it is named itself. Whatever it raises or answers
becomes one line here. Shell.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from positioner.errors import ConfigurationError, Problem
from positioner.inputs.plug_in import (
    Kind,
    file_and_name,
    is_interrupt,
    line_in,
    loaded,
    problem_of,
    text_of_error,
)

_METHODS = ("begin", "advance", "reading", "truth")
_FARTHEST_M = 1.0
"""The limit of the travel stops in a plant file, too."""
_PAGE = "docs/own-plant.md"
_NO_NUMBERS = (bool, str, bytes, bytearray)
"""Types that `float` would take."""


class Truth(NamedTuple):
    """The stem as it is: position and velocity, opening positive."""

    position_m: float
    velocity_m_per_s: float


class OwnPhysics(Protocol):
    """Physics of one's own: what an object offers that is to be a plant; no base class is needed.

    All that changes is in the state, which may be any object and is nobody else's business. Each run begins with a
    state of its own, and never goes back to an earlier one: `advance` may return the state that it was given, changed.
    SI units; mA for the loop current.

    Attributes:
        tables: the tables of a plant file, as a mapping: what a positioner is told of this plant (`[valve]`,
            `[actuator]`, lag and backlash of the `[sensor]`), its geometry, and noise, zero and resolution that are
            added to `reading`. What is missing is that of the preset that `preset` names, or of `paper`; noise is none.
            It may be left out.
    """

    @property
    def tables(self) -> Mapping[str, Any]:
        """The tables of a plant file."""

    def begin(self, seed: int) -> Any:
        """Return the state of a plant at rest; whatever is random follows from `seed` alone."""

    def advance(self, state: Any, current_ma: float, seconds: float) -> Any:
        """Return the state `seconds` later, the loop current held at `current_ma` meanwhile.

        `seconds` is above 0, and is not always the sample period: a command may act between two readings.
        """

    def reading(self, state: Any) -> float:
        """Return the position in m that the sensor shows, from -1 to 1."""

    def truth(self, state: Any) -> tuple[float, float]:
        """Return the position of the stem in m, from -1 to 1, and its velocity in m/s; a `Truth` is such a pair."""


@dataclass(frozen=True, slots=True)
class Running:
    """A plant while it runs: the name and the file of its physics, the object, its state, and its time."""

    name: str
    file: str
    physics: Any
    state: Any
    time_s: float


def made(name: str) -> Any:
    """Return the object of a plug-in plant; a class, or a function without arguments, is called for it.

    Raises:
        ConfigurationError: it cannot be loaded or made, or is part of physics only.
    """
    if file_and_name(name) is None and (problem := problem_of(Kind.PLANT, name, ())):
        raise _refused(name, "plant", problem)
    found, file = loaded(Kind.PLANT, name), ""
    try:
        if isinstance(found, type) or (callable(found) and not _offered(found)):
            file = _file_of(found)
            found = found()
        offered = _offered(found)
    except BaseException as error:  # code of others may raise anything
        raise _told(name, file, "plant", error, "cannot be made: ") from error
    lacks = [each for each in _METHODS if each not in offered]
    if lacks and offered and not isinstance(found, Mapping):
        message = f"has {' and '.join(offered)}, but no {' and no '.join(lacks)}: {_PAGE} shows what physics is"
        raise _refused(name, "plant", message)
    return found


def is_physics(found: object) -> bool:
    """Return whether an object from `made` has its own physics; otherwise it may be tables."""
    return not isinstance(found, Mapping) and bool(_offered(found))


def tables_of(name: str, physics: Any) -> Mapping[str, Any]:
    """Return the tables of physics, empty where it has none.

    Raises:
        ConfigurationError: they are no mapping, or the code behind them fails.
    """
    try:
        tables = physics.tables if hasattr(physics, "tables") else {}
        tables = tables() if callable(tables) else tables
    except BaseException as error:  # code of others may raise anything
        raise _told(name, _file_of(type(physics)), "tables", error) from error
    if not isinstance(tables, Mapping):
        raise _refused(name, "tables", f"is a {type(tables).__name__}; it must be the tables of a plant file")
    return tables


def begun(name: str, seed: int) -> Running:
    """Return the plant whose physics is the plug-in `name` at its beginning; this loads its code.

    Raises:
        ConfigurationError: it cannot be loaded, is no physics, or its code fails.
    """
    physics = made(name)
    if not is_physics(physics):
        text = f"is a {type(physics).__name__} without {', '.join(_METHODS)}: {_PAGE} shows what physics is"
        raise _refused(name, "physics", text)
    file = _file_of(type(physics))
    try:
        state = physics.begin(seed)
    except BaseException as error:  # code of others may raise anything
        raise _told(name, file, "begin", error) from error
    return Running(name, file, physics, state, 0.0)


def advanced(running: Running, current_ma: float, seconds: float) -> Running:
    """Return the plant `seconds` later, under `current_ma`.

    Raises:
        ConfigurationError: its code fails, or returns nothing in place of a state.
    """
    try:
        state = running.physics.advance(running.state, current_ma, seconds)
    except BaseException as error:  # code of others may raise anything
        raise _told(running.name, running.file, _at("advance", running), error) from error
    if state is None and running.state is not None:
        raise _refused(running.name, _at("advance", running), "returns None: return the state that comes next")
    return Running(running.name, running.file, running.physics, state, running.time_s + seconds)


def reading_m(running: Running) -> float:
    """Return the position that the sensor shows, in m.

    Raises:
        ConfigurationError: the code fails, or returns no position.
    """
    try:
        shown = running.physics.reading(running.state)
    except BaseException as error:  # code of others may raise anything
        raise _told(running.name, running.file, _at("reading", running), error) from error
    return _position_m(running, "reading", shown)


def truth_of(running: Running) -> Truth:
    """Return the stem as it is.

    Raises:
        ConfigurationError: the code fails, or returns no pair of position and velocity.
    """
    try:
        position, velocity = running.physics.truth(running.state)
    except (TypeError, ValueError) as error:
        if line_in(error, Path(running.file)) is not None:
            raise _told(running.name, running.file, _at("truth", running), error) from error
        text = f"returns no pair: return (position in m, velocity in m/s); {text_of_error(error)}"
        raise _refused(running.name, _at("truth", running), text) from error
    except BaseException as error:  # code of others may raise anything
        raise _told(running.name, running.file, _at("truth", running), error) from error
    return Truth(_position_m(running, "truth", position), _number(running, "truth", "velocity", velocity))


def _position_m(running: Running, method: str, value: Any) -> float:
    position_m = _number(running, method, "position", value)
    if abs(position_m) > _FARTHEST_M:
        text = f"returns the position {position_m:g} m, beyond {-_FARTHEST_M:g} to {_FARTHEST_M:g} m: return it in m"
        raise _refused(running.name, _at(method, running), text)
    return position_m


def _number(running: Running, method: str, what: str, value: Any) -> float:
    if isinstance(value, _NO_NUMBERS) or not hasattr(value, "__float__"):
        text = f"returns a {type(value).__name__} as {what}: return a number"
        raise _refused(running.name, _at(method, running), text)
    try:
        number = float(value)
    except BaseException as error:  # code of others may raise anything
        raise _told(running.name, running.file, _at(method, running), error) from error
    if not math.isfinite(number):
        text = f"returns the {what} {number}: it must be finite; are the steps of its integration small enough?"
        raise _refused(running.name, _at(method, running), text)
    return number


def _at(method: str, running: Running) -> str:
    return f"{method} at {running.time_s:.6g} s"


def _offered(found: object) -> list[str]:
    return [each for each in _METHODS if callable(getattr(found, each, None))]


def _file_of(code: Any) -> str:
    return getattr(sys.modules.get(getattr(code, "__module__", "")), "__file__", None) or ""


def _told(name: str, file: str, where: str, error: BaseException, before: str = "") -> BaseException:
    """Return what an error out of the code of a plant becomes: one line, or a person's Ctrl-C as it is."""
    if is_interrupt(error):
        return error
    line = line_in(error, Path(file)) if file else None
    return ConfigurationError(name, (Problem(where, line, f"{before}{text_of_error(error)}: mend it ({_PAGE})"),))


def _refused(name: str, where: str, message: str) -> ConfigurationError:
    return ConfigurationError(name, (Problem(where, None, message),))
