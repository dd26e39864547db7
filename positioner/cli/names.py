"""Names of laws and plants on a command line: those of this package, installed ones, and files. Shell."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.errors import UsageError
from positioner.laws.registry import law_names, law_problem
from positioner.machine.completion import suggest
from positioner.studies.conditions import known_plants, plant_mistake

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable


def add_law(parser: argparse._ActionsContainer, text: str, *more: str, option: str = "--law") -> None:
    """Add `--law`, which `law_of` reads; a shell completes the names, and what `more` may stand there."""
    action = parser.add_argument(option, metavar="NAME|FILE.py:NAME", help=text)
    suggest(action, lambda: (*law_names(), *more), "*.py")


def add_plant(parser: argparse.ArgumentParser, text: str) -> None:
    """Add `--plant`, which `plant_of` reads; a shell completes the names."""
    action = parser.add_argument("--plant", metavar="NAME|FILE.toml|FILE.py:NAME", help=text)
    suggest(action, known_plants, "*.toml", "*.py")


def add_signals(parser: argparse.ArgumentParser, more: str = "") -> None:
    """Add `--setpoints` and `--noise`; `more` ends the help of the latter."""
    parser.add_argument(
        "--setpoints",
        metavar="LIST|FILE.csv",
        help="setpoints to play: 73,87 (mm), 50%%,70%% (of span), reach, steps:5%%, ramp:30,from=50%%,to=70%%, "
        "sine:20,amplitude=5%%, or a file with the columns time_s,setpoint_mm (docs/own-law.md)",
    )
    parser.add_argument(
        "--noise",
        metavar="KIND:SIZE",
        help="noise of the position sensor, with σ in %% of span: gaussian:0.05%%, uniform:0.05%%, "
        f"correlated:0.05%%,time=0.1, held:2%%,of=reading,time=0.01{more}",
    )


def law_of(arguments: argparse.Namespace) -> str | None:
    """Return the law that the command line names, None without one.

    Raises:
        UsageError: there is no such law.
    """
    return _known("--law", arguments.law, law_problem)


def shadow_of(arguments: argparse.Namespace) -> str | None:
    """Return the law that `--shadow` names, None without one.

    Raises:
        UsageError: there is no such law.
    """
    return _known("--shadow", arguments.shadow, law_problem)


def plant_of(arguments: argparse.Namespace) -> str | None:
    """Return the plant that the command line names, None without one.

    Raises:
        UsageError: there is no such plant.
    """
    return _known("--plant", arguments.plant, plant_mistake)


def _known(option: str, name: str | None, problem_of: Callable[[str], str | None]) -> str | None:
    if name is not None and (problem := problem_of(name)):
        raise UsageError(f"{option} {name}: {problem}")
    return name
