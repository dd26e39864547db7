"""The league: every law on every plant with every seed, in process, on all cores, resumable. Shell.

A bout is one law on one plant with one seed. It runs `run_in_process`: the daemon's own cycle with the daemon's own
frames.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

from positioner.bench import metrics
from positioner.bench.inprocess import configure, run_in_process
from positioner.bench.scenario import Scenario, check_scenario
from positioner.studies.bouts import played
from positioner.studies.conditions import check_setpoints, setpoints_in_reach
from positioner.studies.entrants import entered
from positioner.studies.pool import EVERY_CORE

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from positioner.studies.pool import Workers

SETPOINTS_MM = (73.0, 87.0, 80.0, 73.5, 81.5, 83.0, 75.0, 85.5)
"""Large, medium and small steps in both directions, all of them where every plant can restart both ways.

With three seeds, 24 dwells for each law on each plant.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class LeagueSettings:
    """The bouts: laws × plants × seeds, with these setpoints, dwell and sample period.

    setpoints_mm: None gives each plant its own, over the whole range from which it can be restarted.
    restarted: each bout is played twice, and judged the second time: the law starts again, with the learned table.
    """

    laws: tuple[str, ...]
    plants: tuple[str, ...]
    seeds: tuple[int, ...]
    setpoints_mm: tuple[float, ...] | None = SETPOINTS_MM
    dwell_s: float = 5.0
    period_s: float = 0.001
    restarted: bool = False

    def setpoints_of(self, plant: str) -> tuple[float, ...]:
        """Return the setpoints of `plant` in mm."""
        return setpoints_in_reach(plant) if self.setpoints_mm is None else self.setpoints_mm

    def bouts(self) -> Iterator[Bout]:
        """Yield every bout, the slow laws first, so that the cores end together."""
        for law in sorted(self.laws, key=lambda name: not name.startswith(("paper", "nmpc"))):
            for plant in self.plants:
                for seed in self.seeds:
                    setpoints_mm = self.setpoints_of(plant)
                    yield Bout(law, plant, seed, setpoints_mm, self.dwell_s, self.period_s, self.restarted)


@dataclass(frozen=True, slots=True)
class Bout:
    """One law on one plant with one seed."""

    law: str
    plant: str
    seed: int
    setpoints_mm: tuple[float, ...]
    dwell_s: float
    period_s: float
    restarted: bool = False

    @property
    def key(self) -> str:
        """Name of the result file; it changes with all that the result depends on, except the code."""
        text = json.dumps(asdict(self)).encode()
        return f"{self.law}-{self.plant}-{self.seed}-{hashlib.sha256(text).hexdigest()[:10]}"

    @property
    def title(self) -> str:
        """What the progress bar shows."""
        return f"{self.law} on {self.plant}"

    @property
    def scenario(self) -> Scenario:
        """The scenario of the bout."""
        scenario = Scenario(
            name=f"league-{self.plant}"[:40],
            title=self.title,
            law=self.law,
            seed=self.seed,
            sample_period_s=self.period_s,
            setpoint_period_s=10.0 * self.period_s,
            setpoints_mm=self.setpoints_mm,
            dwell_s=self.dwell_s,
            plant={"preset": self.plant},
        )
        return entered(scenario)


def play(bout: Bout) -> tuple[metrics.DwellMetrics, ...]:
    """Return the figures of every dwell of a bout."""
    scenario = bout.scenario
    table = run_in_process(scenario).table if bout.restarted else None
    trace = run_in_process(scenario, table).recording.trace
    return metrics.dwell_metrics(trace, scenario.dwell_edges_s, configure(scenario).valve.span_m)


def play_league(
    settings: LeagueSettings, folder: Path, workers: Workers = EVERY_CORE
) -> dict[Bout, tuple[metrics.DwellMetrics, ...]]:
    """Return the figures of every bout; a bout with a result of the same code in `folder` is not played again.

    Raises:
        ConfigurationError: some plant cannot be restarted from a setpoint, or a period, dwell or seed is out of its
            limits.
        StateError: `folder` cannot be written.
    """
    for plant in settings.plants:
        check_setpoints(settings.setpoints_of(plant), (plant,))
    bouts = tuple(settings.bouts())
    for bout in {bout.seed: bout for bout in bouts}.values():
        check_scenario(bout.scenario, "league")
    return played(bouts, play, folder, workers)
