"""The table that each acceptance of commissioning and diagnostics prints: its goals, its figures, what is met."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from tqdm import tqdm

if TYPE_CHECKING:
    from collections.abc import Iterable


def show(rows: Iterable[tuple[str, str, str, bool]]) -> int:
    """Print quantity, goal, figure and whether it is met of each row; return the exit status, 1 where one is missed."""
    rows = list(rows)
    told = [f"| {name} | {goal} | {figure} | {'yes' if met else '**no**'} |" for name, goal, figure, met in rows]
    tqdm.write("\n".join(["| quantity | goal | figure | met |", "|---|---|---|---|", *told]), file=sys.stdout)
    return 0 if all(met for *_, met in rows) else 1
