"""Parameters of the rival laws at each lag: packaged results of `positioner tune --real-valves`. Shell: reads files.

The moves of `two-move-retry` last 70 ms and five time constants, by which the pressure has arrived.
"""

from __future__ import annotations

from functools import cache
from importlib import resources
from typing import Any

from positioner.inputs import toml_reader
from positioner.laws.tuned import table_name

FOLDER = "real_valves"
_MOVE_S = 0.07
_MOVE_LAGS = 5.0
_RETRY = {"averaging_s": 0.15, "tolerance_m": 0.0005, "most_retries": 8, "learning_gain": 1.0}


def rival_tables(law: str, lag_s: float, noise: str) -> dict[str, Any]:
    """Return the `[control]` table of `law` at this lag and noise; empty where its packaged parameters hold everywhere.

    Between two lags for which it was tuned, the parameters are those of the nearest one.
    """
    moves = {"move_s": round(_MOVE_S + _MOVE_LAGS * lag_s, 4), "back_off_m": 0.012}
    if law == "two-move":
        return {table_name(law): moves}
    found = [entry for entry in _tuned(law) if entry["noise"] == noise]
    nearest = min(found, key=lambda entry: abs(float(entry["lag_s"]) - lag_s), default={})
    table = nearest.get(table_name(law), {})
    if law == "two-move-retry":
        table = {**_RETRY, **table, "moves": moves}
    return {table_name(law): table} if table else {}


@cache
def _tuned(law: str) -> tuple[dict[str, Any], ...]:
    file = resources.files("positioner.laws.tuned").joinpath(FOLDER, f"{table_name(law)}.toml")
    if not file.is_file():
        return ()
    return tuple(toml_reader.tables(file.read_text(encoding="utf-8"), file.name)["tuned"])
