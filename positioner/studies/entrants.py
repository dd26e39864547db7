"""The entrants of a league: every law, and `nmpc` without its stiction table. Pure."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from positioner.errors import UsageError
from positioner.laws.registry import LAWS, law_problem

if TYPE_CHECKING:
    from positioner.bench.scenario import Scenario

OURS = "nmpc"
WITHOUT_TABLE = "nmpc-without-table"
"""The same law, which learns but never uses what stands in the table."""
ENTRANTS = (*LAWS, WITHOUT_TABLE)
_NEVER_S = 1e9


def entrants_in(given: str) -> tuple[str, ...]:
    """Return the names of laws in a list with commas, each once; those from outside, too.

    Raises:
        UsageError: one is no law.
    """
    names = tuple(dict.fromkeys(name.strip() for name in given.split(",")))
    for name in names:
        if problem := law_problem(name, ENTRANTS):
            raise UsageError(f"law {name!r} {problem}")
    return names


def entered(scenario: Scenario) -> Scenario:
    """Return the scenario of an entrant as one that a positioner knows."""
    if scenario.law != WITHOUT_TABLE:
        return scenario
    return replace(scenario, law=OURS, table_from_s=_NEVER_S)
