"""Documents as procedures give them, small ones."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

from positioner.commissioning.results import KeptResult

HOSTILE = '<b onclick="x()">&"\''
MOMENT = datetime(2026, 3, 9, 14, 5, tzinfo=UTC)


def row(name: str, unit: str, value: float, off: float = 0.0) -> dict[str, Any]:
    return {"name": name, "unit": unit, "value": value, "low": value - off, "high": value + off, "seen": True}


SIGNATURE: dict[str, Any] = {
    "valve": "FV-101",
    "rows": [
        row("spring rate", "N/m", 52538.0, 40.0),
        row("spring force at 0", "N", -0.25, 3.0),
        row("sliding friction", "N", 1807.2, 7.0),
        row("hysteresis", "% of span", 54.15),
    ],
    "sliding_friction_by_place": [[0.06, 1800.0], [0.07, 1810.0], [0.08, 1812.0]],
    "breakaways": [[0.061, 1.0, 2150.0], [0.075, -1.0, 2170.0]],
    "loop": [
        {"direction": 1.0, "pressure_ma": [15.0, 16.0, 20.0], "position_m": [0.06, 0.067, 0.0926]},
        {"direction": -1.0, "pressure_ma": [20.0, None, 4.0], "position_m": [0.0926, 0.08, 0.06]},
    ],
    "remarks": ["from 4 places of the travel, and 9 breakaways"],
}


def result(kind: str, document: dict[str, Any], name: str = "a") -> KeptResult:
    return KeptResult(kind, name, "FV-101", MOMENT, {"positioner": "0.1.0 (interpreted)"}, document)
