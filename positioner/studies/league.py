"""The league: every law on every plant with every seed, in process, on all cores, resumable. Shell.

A bout is one law on one plant with one seed. It runs `run_in_process`: the daemon's own cycle with the daemon's own
frames.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from plant_emulator.plants import complete_tables, plant_named
from plant_emulator.presets import plant_settings, preset_names
from positioner.bench import metrics
from positioner.bench.inprocess import configure, run_in_process
from positioner.bench.own_plant import on_own_plant
from positioner.bench.scenario import Scenario, check_scenario
from positioner.bench.sensor_noise import with_noise
from positioner.bench.setpoints import Setpoints, setpoints_in
from positioner.errors import ConfigurationError
from positioner.studies.bouts import computed, file_name, law_failure
from positioner.studies.conditions import check_setpoints, setpoints_in_reach
from positioner.studies.entrants import entered
from positioner.studies.pool import EVERY_CORE

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from positioner.studies.pool import Workers

SETPOINTS_MM = (73.0, 87.0, 80.0, 73.5, 81.5, 83.0, 75.0, 85.5)
"""Large, medium and small steps in both directions, all of them where every plant can restart both ways.

With three seeds, 24 dwells for each law on each plant.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class LeagueSettings:
    """The bouts: laws × plants × seeds, with these setpoints, dwell and sample period.

    setpoints_mm: in mm, for the presets; None gives each plant its own, over the whole range from which it can be
        restarted, as a plant of one's own always has it.
    setpoints: others in place of them, as a command line names them (`bench.setpoints`).
    noise: that of the sensor of every plant, as a command line names it (`bench.sensor_noise`); None: its own.
    restarted: each bout is played twice, and judged the second time: the law starts again, with the learned table.
    """

    laws: tuple[str, ...]
    plants: tuple[str, ...]
    seeds: tuple[int, ...]
    setpoints_mm: tuple[float, ...] | None = SETPOINTS_MM
    dwell_s: float = 5.0
    period_s: float = 0.001
    restarted: bool = False
    setpoints: str | None = None
    noise: str | None = None

    def setpoints_of(self, plant: str) -> Setpoints:
        """Return the setpoints of `plant`.

        Raises:
            UsageError, ConfigurationError: as `bench.setpoints.setpoints_in`.
        """
        if self.setpoints is not None:
            return setpoints_in(self.setpoints, plant_named(plant), 10.0 * self.period_s)
        if self.setpoints_mm is None or plant not in preset_names():
            return Setpoints(setpoints_in_reach(plant))
        return Setpoints(self.setpoints_mm)

    def bouts(self) -> Iterator[Bout]:
        """Yield every bout, the slow laws first, so that the cores end together."""
        for law in sorted(self.laws, key=lambda name: not name.startswith(("paper", "nmpc"))):
            for plant in self.plants:
                found, own = self.setpoints_of(plant), _own(plant)
                dwell_s = self.dwell_s if found.each_s is None else found.each_s
                for seed in self.seeds:
                    yield Bout(
                        law,
                        plant,
                        seed,
                        found.mm,
                        dwell_s,
                        self.period_s,
                        self.restarted,
                        own,
                        found.edges_s,
                        self.noise,
                    )


@dataclass(frozen=True, slots=True)
class Bout:
    """One law on one plant with one seed; `own` is the plant as JSON, where it is no preset: workers need no file."""

    law: str
    plant: str
    seed: int
    setpoints_mm: tuple[float, ...]
    dwell_s: float
    period_s: float
    restarted: bool = False
    own: str = ""
    edges_s: tuple[float, ...] = ()
    noise: str | None = None

    @property
    def key(self) -> str:
        """Name of the result file; it changes with all that the result depends on, except the code."""
        text = json.dumps(asdict(self)).encode()
        names = file_name(f"{self.law}-{self.plant}-{self.seed}")
        return f"{names}-{hashlib.sha256(text).hexdigest()[:10]}"

    @property
    def physics(self) -> str:
        """The name of the plant's own physics, empty where it has those of the emulator."""
        return str(json.loads(self.own).get("physics", "")) if self.own else ""

    @property
    def title(self) -> str:
        """What the progress bar shows."""
        return f"{self.law} on {self.plant}"

    @property
    def scenario(self) -> Scenario:
        """The scenario of the bout."""
        scenario = Scenario(
            name=file_name(f"league-{self.plant}")[:40],
            title=self.title[:80],
            law=self.law,
            seed=self.seed,
            sample_period_s=self.period_s,
            setpoint_period_s=10.0 * self.period_s,
            setpoints_mm=self.setpoints_mm,
            dwell_s=self.dwell_s,
            edges_s=self.edges_s,
            plant={} if self.own else {"preset": self.plant},
        )
        if self.own:
            scenario = on_own_plant(scenario, plant_settings(overrides=json.loads(self.own)))
        if self.noise is not None:
            scenario = with_noise(scenario, self.noise)
        return entered(scenario)


def _own(plant: str) -> str:
    return "" if plant in preset_names() else json.dumps(complete_tables(plant_named(plant)))


@dataclass(frozen=True, slots=True)
class Outcome:
    """The figures of every dwell of a bout, or the error of code from outside, its law or its plant's own physics."""

    dwells: tuple[metrics.DwellMetrics, ...]
    failure: str = ""


def play(bout: Bout) -> Outcome:
    """Return the outcome of a bout."""
    scenario = bout.scenario
    try:
        table = run_in_process(scenario).table if bout.restarted else None
        run = run_in_process(scenario, table)
    except ConfigurationError as error:
        if not bout.physics:
            raise
        return Outcome((), str(error))
    if failure := law_failure(scenario.law, run.events):
        return Outcome((), failure)
    span_m = configure(scenario).valve.span_m
    return Outcome(metrics.dwell_metrics(run.recording.trace, scenario.dwell_edges_s, span_m))


def play_league(
    settings: LeagueSettings,
    folder: Path,
    workers: Workers = EVERY_CORE,
    tell: Callable[[Bout, str], object] = lambda _bout, _failure: None,
) -> dict[Bout, tuple[metrics.DwellMetrics, ...]]:
    """Return the figures of every bout; a bout with a result of the same code in `folder` is not played again.

    A bout whose law, or whose plant's own physics, raised an error has no figures: `tell` gets it with the error.

    Raises:
        ConfigurationError: some plant cannot be restarted from a setpoint, a period, dwell or seed is out of its
            limits, or a law from outside cannot be made.
        StateError: `folder` cannot be written.
    """
    for plant in settings.plants:
        check_setpoints(settings.setpoints_of(plant).mm, (plant,))
    bouts = tuple(settings.bouts())
    for bout in {bout.seed: bout for bout in bouts}.values():
        check_scenario(bout.scenario, "league")
    for bout in {bout.law: bout for bout in bouts}.values():
        configure(bout.scenario).make_law(
            plays=True
        )  # a law from outside that cannot be made is told before workers start
    found = {}
    for bout, result in computed(bouts, play, folder, workers, _as_json).items():
        if isinstance(result, str):
            tell(bout, result)
        else:
            found[bout] = tuple(metrics.DwellMetrics(**dwell) for dwell in result)
    return found


def _as_json(outcome: Outcome) -> list[dict[str, Any]] | str:
    return outcome.failure or [asdict(dwell) for dwell in outcome.dwells]
