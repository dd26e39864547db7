"""One run of a campaign: a function of its scenario alone, and the figures that it returns. Pure."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass, fields
from typing import TYPE_CHECKING, Any

from positioner.bench import metrics
from positioner.bench.inprocess import configure, run_in_process
from positioner.bench.modes import active_fraction, mode_spans
from positioner.bench.playable import check_playable
from positioner.errors import BenchError
from positioner.studies.bouts import law_failure

if TYPE_CHECKING:
    from positioner.bench.scenario import Scenario
    from positioner.campaign.schema import Value

_LABELS = ("name", "title", "description")
"""Parts of a scenario on which no figure depends."""


def played_part(scenario: Scenario) -> dict[str, Any]:
    """Return the settings of a scenario on which figures depend."""
    return {name: value for name, value in asdict(scenario).items() if name not in _LABELS}


def digest_of(settings: dict[str, Any]) -> str:
    """Return a digest of settings, in whatever order they are given."""
    return hashlib.sha256(json.dumps(settings, sort_keys=True).encode()).hexdigest()


@dataclass(frozen=True, slots=True)
class Run:
    """One law at one point with one seed of the noise; `values` are those of the parameters."""

    point: int
    values: tuple[Value, ...]
    scenario: Scenario

    @property
    def law(self) -> str:
        """The law that is played."""
        return self.scenario.law

    @property
    def seed(self) -> int:
        """The seed of the noise."""
        return self.scenario.seed

    @property
    def physics(self) -> str:
        """The name of the plant's own physics, empty where it has those of the emulator."""
        return str(self.scenario.plant.get("physics", ""))

    @property
    def label(self) -> str:
        """What the progress bar shows."""
        return f"{self.law} at point {self.point}"

    @property
    def key(self) -> str:
        """A digest of all that the figures depend on, except the code."""
        return digest_of(played_part(self.scenario))


@dataclass(frozen=True, slots=True, kw_only=True)
class Figures(metrics.Totals):
    """The figures of a bench, and what else a row holds.

    active_fraction: part of the run in which the law was in control. learned: samples in the table at the end.
    """

    active_fraction: float
    learned: int


COLUMNS = ("point", "law", "seed", *(field.name for field in fields(Figures)), "failure")
"""The columns of the results, without those of the parameters."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """The figures of a run, or what ended it before its time: such a run fails in the same way each time."""

    figures: Figures | None
    failure: str | None = None


def outcome_of(kept: dict[str, Any]) -> Outcome:
    """Return the outcome in a line of the journal.

    Raises:
        TypeError: it is of a version with other figures.
    """
    return Outcome(None if kept["figures"] is None else Figures(**kept["figures"]), kept["failure"])


@dataclass(frozen=True, slots=True)
class PlayedRun:
    """A run with its outcome."""

    run: Run
    outcome: Outcome


def play(run: Run) -> Outcome:
    """Return the outcome of `run`."""
    try:
        return Outcome(_figures(run.scenario))
    except (MemoryError, OSError):
        raise  # the machine, not the run
    except Exception as error:  # noqa: BLE001 - one run at the end of a range must not end the campaign
        return Outcome(None, f"{type(error).__name__}: {error}")


def _figures(scenario: Scenario) -> Figures:
    configuration = configure(scenario)
    plant = check_playable(scenario, configuration)
    played = run_in_process(scenario)
    if failure := law_failure(scenario.law, played.events):
        raise BenchError(failure)
    played.recording.read_modes()
    dwells = metrics.dwell_metrics(played.recording.trace, scenario.dwell_edges_s, configuration.valve.span_m)
    # silent after the actuator's deadman time, but not before three periods, as in a bench
    silent_s = max(plant.deadman_s, 3.0 * scenario.sample_period_s)
    modes = mode_spans(played.recording.mode_reports, scenario.duration_s, silent_s)
    return Figures(
        **asdict(metrics.totals(dwells)), active_fraction=active_fraction(modes), learned=played.table.sequence
    )
