"""The entrants of a league: every law, and `nmpc` without its stiction table. Pure."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from positioner.laws.registry import LAWS

if TYPE_CHECKING:
    from positioner.bench.scenario import Scenario

OURS = "nmpc"
WITHOUT_TABLE = "nmpc-without-table"
"""The same law, which learns but never uses what stands in the table."""
ENTRANTS = (*LAWS, WITHOUT_TABLE)
_NEVER_S = 1e9


def entered(scenario: Scenario) -> Scenario:
    """Return the scenario of an entrant as one that a positioner knows."""
    if scenario.law != WITHOUT_TABLE:
        return scenario
    return replace(scenario, law=OURS, table_from_s=_NEVER_S)
