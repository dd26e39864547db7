"""The bouts of the league on real valves: law × plant × lag × noise × seed, and those of the conditions. Pure.

Laws that neither use the stiction table nor learn for it run without frames, several times as fast.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

from plant_emulator.presets import plant_settings
from positioner.bench import metrics
from positioner.bench.configure import told
from positioner.bench.inprocess import configure, run_in_process
from positioner.bench.scenario import Scenario
from positioner.errors import BenchError
from positioner.studies.bouts import file_name, law_failure
from positioner.studies.direct import play_directly
from positioner.studies.entrants import OURS, entered
from positioner.studies.real_valves.conditions import AS_CONFIGURED, CONDITIONS, Condition
from positioner.studies.real_valves.tuned import rival_tables
from positioner.studies.real_valves.valves import GRAPHITE, NOISES, NOMINAL, plant_tables, setpoints_mm

if TYPE_CHECKING:
    from collections.abc import Iterator

RIVALS = ("pi", "pi-deadband", "knocker", "constant-reinforcement", "two-move", "two-move-retry")
SEEDS = (201, 202, 203)
"""Seeds of this league; laws are never tuned on them."""
LONG_LAG_S = 0.2
LONG_DWELL_S = 20.0
"""Dwell at lags above `LONG_LAG_S`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RealLeagueSettings:
    """What is played; the dwell is longer where the lag is.

    rival_plants: the plants of the other laws. conditions: for `nmpc` alone.
    identified: whether the laws have the parameters that an identification of each plant finds, and not the exact ones;
        in a condition they always have exact ones.
    """

    laws: tuple[str, ...]
    plants: tuple[str, ...]
    rival_plants: tuple[str, ...]
    lags_s: tuple[float, ...]
    noises: tuple[str, ...]
    seeds: tuple[int, ...]
    conditions: tuple[str, ...] = ()
    setpoints: int = 8
    dwell_s: float = 6.0
    period_s: float = 0.001
    identified: bool = False

    def bouts(self) -> Iterator[RealBout]:
        """Yield every bout: the main part for all laws, the conditions for `nmpc` alone."""
        for law in self.laws:
            for plant in self.plants if law.startswith(OURS) else self.rival_plants:
                lags_s = (own_lag_s(plant),) if plant == GRAPHITE else self.lags_s
                for lag_s in lags_s:
                    yield from self._each(law, plant, lag_s, AS_CONFIGURED)
        if OURS in self.laws:
            for name in self.conditions:
                for lag_s in CONDITIONS[name].lags_s:
                    yield from self._each(OURS, NOMINAL, lag_s, name)

    def _each(self, law: str, plant: str, lag_s: float, name: str) -> Iterator[RealBout]:
        condition = CONDITIONS.get(name)
        noises = self.noises if condition is None else [noise for noise in self.noises if noise in condition.goal_pct]
        other = condition or Condition(text=AS_CONFIGURED, goal_pct={})
        longer_s = LONG_DWELL_S / 6.0 * self.dwell_s if lag_s > LONG_LAG_S else self.dwell_s
        for noise in noises:
            for seed in self.seeds:
                yield RealBout(
                    law=law,
                    plant=plant,
                    lag_s=lag_s,
                    noise=noise,
                    seed=seed,
                    condition=name,
                    setpoints=min(self.setpoints, other.setpoints),
                    dwell_s=round(other.dwell_s or longer_s, 1),
                    period_s=other.period_s or self.period_s,
                )


@dataclass(frozen=True, slots=True, kw_only=True)
class RealBout:
    """One law on one plant with one lag, noise and seed, under one condition.

    identified: what its identification found, as JSON; empty where the law has the plant's own parameters.
    """

    law: str
    plant: str
    lag_s: float
    noise: str
    seed: int
    condition: str
    setpoints: int
    dwell_s: float
    period_s: float
    identified: str = ""

    @property
    def title(self) -> str:
        """What the progress bar shows."""
        where = self.plant if self.condition == AS_CONFIGURED else self.condition
        return f"{self.law} on {where}, lag {self.lag_s * 1e3:g} ms, noise {self.noise} %"

    @property
    def key(self) -> str:
        """Name of the result file; it changes with all that the result depends on, except the code."""
        text = json.dumps(asdict(self)).encode()
        names = file_name(f"{self.law}-{self.plant}-{self.lag_s * 1e3:g}ms-{self.seed}")
        return f"{names}-{hashlib.sha256(text).hexdigest()[:10]}"

    @property
    def scenario(self) -> Scenario:
        """The scenario of the bout."""
        condition = CONDITIONS.get(self.condition) or Condition(text=AS_CONFIGURED, goal_pct={})
        true = plant_tables(self.plant, self.lag_s, self.noise, condition.true(self.lag_s))
        believed = plant_tables(self.plant, self.lag_s, self.noise, condition.believed(self.lag_s))
        known = {"valve": told(plant_settings(overrides=believed)), "estimator": dict(NOISES[self.noise])}
        if self.identified:
            known = json.loads(self.identified)
        scenario = Scenario(
            name="real-valves",
            title=self.title[:80],
            law=self.law,
            seed=self.seed,
            sample_period_s=self.period_s,
            setpoint_period_s=10.0 * self.period_s,
            setpoints_mm=setpoints_mm(plant_settings(overrides=true))[: self.setpoints],
            dwell_s=self.dwell_s,
            plant=true,
            valve=known["valve"],
            estimator=known["estimator"],
            control=rival_tables(self.law, self.lag_s, self.noise),
        )
        return entered(scenario)


def own_lag_s(plant: str) -> float:
    """Return the time constant of filling of a preset, which the league leaves as it is."""
    return plant_settings(plant).actuator.fill_time_constant_s


def play(bout: RealBout) -> tuple[metrics.DwellMetrics, ...]:
    """Return the figures of every dwell of a bout.

    Raises:
        BenchError: its law, which is from outside, raised an error.
    """
    scenario = bout.scenario
    if bout.law in RIVALS:
        return tuple(play_directly(scenario))
    run = run_in_process(scenario)
    if failure := law_failure(scenario.law, run.events):
        raise BenchError(failure)
    return metrics.dwell_metrics(run.recording.trace, scenario.dwell_edges_s, configure(scenario).valve.span_m)
