"""A campaign of short runs, and what is counted of it."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from positioner.campaign.reader import load_campaign
from positioner.campaign.run import Outcome, Run, play

if TYPE_CHECKING:
    from positioner.campaign.plan import Campaign

TEXT = """
name = "small"
title = "Short runs"
laws = ["pi"]
seeds = [1, 2]

[design]
kind = "sobol"
points = 4

[scenario]
setpoints_mm = [75.0]
visits = 1
dwell_s = 0.02

[parameters]
"plant.valve.spring_rate_n_per_m" = { low = 50e3, high = 55e3 }
"control.pi.filter_time_constant_s" = { low = 0.001, high = 0.01, scale = "logarithmic" }
"""


def small(folder: Path, **changes: str) -> Campaign:
    """Return the campaign of `TEXT`, with texts in place of others."""
    text = TEXT
    for old, new in changes.items():
        text = text.replace(_LINES[old], new)
    path = folder / "small.toml"
    path.write_text(text, encoding="utf-8")
    return load_campaign(path)


_LINES = {"laws": 'laws = ["pi"]', "seeds": "seeds = [1, 2]", "points": "points = 4", "dwell": "dwell_s = 0.02"}
STARTED = "POSITIONER_TEST_STARTED"
"""Names the file that gets a line for each run that is started."""


def counted(run: Run) -> Outcome:
    """Play a run and count it."""
    with Path(os.environ[STARTED]).open("a", encoding="ascii") as file:
        file.write(f"{run.key}\n")
    return play(run)


def started() -> list[str]:
    """Return the key of each run that was started, in order."""
    path = Path(os.environ[STARTED])
    return path.read_text(encoding="ascii").split() if path.exists() else []


def rows(path: Path) -> list[dict[str, Any]]:
    """Return the rows of a Parquet file."""
    from pyarrow import parquet  # noqa: PLC0415 - the processes that only play need it not

    found: list[dict[str, Any]] = parquet.read_table(path).to_pylist()
    return found
