"""The league on real valves: every bout, resumable, on all cores. Shell."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from positioner.bench.inprocess import configure
from positioner.bench.playable import check_playable
from positioner.bench.scenario import check_scenario
from positioner.studies.bouts import computed, played
from positioner.studies.pool import EVERY_CORE
from positioner.studies.real_valves.bouts import play
from positioner.studies.real_valves.conditions import AS_CONFIGURED
from positioner.studies.real_valves.identification import Identification, as_text, identify
from positioner.studies.real_valves.results import results_of

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from positioner.studies.pool import Workers
    from positioner.studies.real_valves.bouts import RealBout, RealLeagueSettings
    from positioner.studies.real_valves.results import Results


def play_real_league(settings: RealLeagueSettings, folder: Path, workers: Workers = EVERY_CORE) -> Results:
    """Return the results; a bout with a result of the same code in `folder` is not played again.

    Raises:
        ConfigurationError: a lag, period, dwell or seed is out of its limits.
        StateError: `folder` cannot be written.
    """
    check(settings)
    bouts = list(settings.bouts())
    if settings.identified:
        bouts = _identified(bouts, folder, workers)
    # our law first, and the long dwells of it: the cores then end together
    bouts.sort(key=lambda bout: (not bout.law.startswith("nmpc"), -bout.dwell_s))
    return results_of(played(bouts, play, folder, workers), settings.setpoints)


def check(settings: RealLeagueSettings) -> None:
    """Refuse what cannot be played.

    Raises:
        ConfigurationError: a lag, period, dwell or seed is out of its limits.
    """
    for scenario in {(bout.seed, bout.period_s, bout.lag_s): bout.scenario for bout in settings.bouts()}.values():
        check_scenario(scenario, "league")
        check_playable(scenario, configure(scenario))


def _identified(bouts: Sequence[RealBout], folder: Path, workers: Workers) -> list[RealBout]:
    """Return the bouts with what an identification of each plant finds; conditions stay as they are."""
    items = {
        bout: Identification(bout.plant, bout.lag_s, bout.noise, bout.period_s)
        for bout in bouts
        if bout.condition == AS_CONFIGURED
    }
    found = computed(list(dict.fromkeys(items.values())), identify, folder, workers)
    return [replace(bout, identified=as_text(found[items[bout]])) if bout in items else bout for bout in bouts]
