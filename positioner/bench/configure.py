"""From a scenario to the daemon's configuration. Pure."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import tomli_w

if TYPE_CHECKING:
    from pathlib import Path

    from positioner.bench.scenario import Scenario
    from positioner.bus_address import BusAddress

VALVE_ID = "bench"
"""Identity of the emulated valve: one table serves all scenarios, if the user carries it over with --state."""


def configuration_text(scenario: Scenario, address: BusAddress, state: Path) -> str:
    """Return the `valve.toml` of the daemon that `scenario` asks for."""
    control: dict[str, Any] = {"law": scenario.law, "sample_period_s": scenario.sample_period_s}
    if scenario.table_from_s is not None:
        control["table_from_s"] = scenario.table_from_s
    tables: dict[str, Any] = {
        "valve": {"id": VALVE_ID, **scenario.valve},
        "bus": {key: value for key, value in asdict(address).items() if value != {}},
        "control": {**control, **scenario.control},
        "estimator": scenario.estimator,
        "guard": {"auto_arm": True, **scenario.guard},
        "state": {"directory": str(state)},
    }
    return tomli_w.dumps(tables)
