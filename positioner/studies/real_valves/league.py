"""The league on real valves: every bout, resumable, on all cores. Shell."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.bench.inprocess import configure
from positioner.bench.playable import check_playable
from positioner.bench.scenario import check_scenario
from positioner.studies.bouts import played
from positioner.studies.pool import EVERY_CORE
from positioner.studies.real_valves.bouts import play
from positioner.studies.real_valves.results import results_of

if TYPE_CHECKING:
    from pathlib import Path

    from positioner.studies.pool import Workers
    from positioner.studies.real_valves.bouts import RealLeagueSettings
    from positioner.studies.real_valves.results import Results


def play_real_league(settings: RealLeagueSettings, folder: Path, workers: Workers = EVERY_CORE) -> Results:
    """Return the results; a bout with a result of the same code in `folder` is not played again.

    Raises:
        ConfigurationError: a lag, period, dwell or seed is out of its limits.
        StateError: `folder` cannot be written.
    """
    # our law first, and the long dwells of it: the cores then end together
    bouts = sorted(settings.bouts(), key=lambda bout: (not bout.law.startswith("nmpc"), -bout.dwell_s))
    for scenario in {(bout.seed, bout.period_s, bout.lag_s): bout.scenario for bout in bouts}.values():
        check_scenario(scenario, "league")
        check_playable(scenario, configure(scenario))
    return results_of(played(bouts, play, folder, workers), settings.setpoints)
