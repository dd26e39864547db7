"""`python -m documents.belief FILE.png` draws what `nmpc` believes of a valve before and after first moves. Shell."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from positioner.bench.inprocess import configure, run_in_process
from positioner.bench.scenario import Scenario
from positioner.laws.nmpc.belief import LEAST_LAG_S
from positioner.pictures.colours import CLOSING, INK, OPENING
from positioner.pictures.files import save
from positioner.pictures.panels import LABEL, NORMAL, SMALL, dress, new_figure
from positioner.valve.parameters import ValveParameters

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from positioner.laws.law import Decision, Estimate, Law, Observation
    from positioner.laws.nmpc.belief import ValveBelief
    from positioner.valve.state import StemState
    from positioner.valve.stiction import StictionTable

SHOWN = (0, 1, 5)
"""After so many setpoints."""
_SETPOINTS_MM = (97.0, 82.0, 90.0, 80.0, 95.0, 86.0)
_LAG_S, _TRUE_LAG_S = 0.05, 0.065
_TOLD = ValveParameters(id="paper")
_SPRING, _FRICTION = 0.85, 1.25
"""Of what is configured."""
_SIGMAS = 2.0


@dataclass
class Watched:
    """A law, and what it believed and had learned at the begin of each setpoint."""

    law: Law[Any]
    beliefs: list[ValveBelief] = field(default_factory=list)
    _setpoint_m: float | None = None

    @property
    def name(self) -> str:
        """The name of the law."""
        return self.law.name

    def begin(self, measured_m: float) -> Any:
        """Return the memory of the law."""
        return self.law.begin(measured_m)

    def estimate(self, memory: Any, observation: Observation) -> tuple[Any, Estimate]:
        """Return what the law makes of a reading."""
        return self.law.estimate(memory, observation)

    def decide(
        self, memory: Any, stem: StemState, observation: Observation, table: StictionTable
    ) -> tuple[Any, Decision]:
        """Return what the law decides, and keep its belief where the setpoint is new."""
        if observation.setpoint_m != self._setpoint_m:
            self._setpoint_m = observation.setpoint_m
            self.beliefs.append(memory.belief)
        return self.law.decide(memory, stem, observation, table)


def scenario() -> Scenario:
    """Return setpoints on a valve behind a lag; spring, friction and lag are not the configured ones."""
    plant: dict[str, Any] = {
        "preset": "real-valve",
        "valve": {
            "spring_rate_n_per_m": _SPRING * _TOLD.spring_rate_n_per_m,
            "static_friction_n": _FRICTION * _TOLD.static_friction_n,
            "coulomb_friction_n": _FRICTION * _TOLD.coulomb_friction_n,
        },
        "actuator": {"fill_time_constant_s": _TRUE_LAG_S, "vent_time_constant_s": _TRUE_LAG_S},
        "sensor": {"noise_of_reading": 0.0, "noise_of_span": 0.0005},
    }
    told = {"actuator": {"fill_time_constant_s": _LAG_S, "vent_time_constant_s": _LAG_S}}
    return Scenario(
        name="belief",
        title="belief",
        law="nmpc",
        seed=1,
        setpoints_mm=_SETPOINTS_MM,
        dwell_s=2.0,
        plant=plant,
        valve=told,
        estimator={"noise_of_reading": 0.0, "noise_of_span": 0.0005},
    )


def true_ma(valve: ValveParameters, place_m: float, direction: float) -> float:
    """Return the pressure in mA at which a stem of the played valve that slides in `direction` (±1) stops there."""
    force_n = _SPRING * valve.spring_rate_n_per_m * place_m + direction * _FRICTION * valve.coulomb_friction_n
    return force_n / valve.force_gain_n_per_ma


def beliefs() -> tuple[ValveParameters, list[ValveBelief]]:
    """Return the configured valve, and the belief at the begin of each setpoint."""
    configuration = configure(scenario())
    watched = Watched(configuration.make_law())
    run_in_process(scenario(), law=watched)
    return configuration.valve, watched.beliefs


def draw(path: Path) -> None:
    """Write the picture."""
    valve, found = beliefs()
    figure = new_figure(4.6)
    figure.set_layout_engine("constrained")
    panels = figure.subplots(1, len(SHOWN), sharex=True, sharey=True)
    for panel, number in zip(panels, SHOWN, strict=True):
        _draw(panel, valve, found[number])
        after = "as configured" if not number else f"after {number} setpoint{'s' * (number > 1)}"
        panel.set_title(f"{after}\n{_words(valve, found[number])}", loc="left", fontsize=NORMAL, color=INK)
        panel.set_xlabel("position, mm", fontsize=LABEL)
    panels[0].set_ylabel("pressure, mA", fontsize=LABEL)
    save(figure, path)


def _draw(panel: Axes, valve: ValveParameters, belief: ValveBelief) -> None:
    """Draw where slides end, as believed and as it is, and the landings so far."""
    place_m = np.linspace(0.06, 0.12, 60)
    for direction, colour, name in ((1.0, OPENING, "opening"), (-1.0, CLOSING, "closing")):
        mean_ma = np.array([belief.balance_ma(x) + direction * belief.sliding_ma for x in place_m])
        sigma_ma = np.sqrt([belief.numbers.variance((x, 1.0, direction, 0.0)) for x in place_m])
        low_ma, high_ma = mean_ma - _SIGMAS * sigma_ma, mean_ma + _SIGMAS * sigma_ma
        panel.fill_between(place_m * 1e3, low_ma, high_ma, color=colour, alpha=0.2, linewidth=0.0)
        panel.plot(place_m * 1e3, mean_ma, color=colour, linewidth=1.8, label=f"where slides end, {name}")
        truth_ma = [true_ma(valve, x, direction) for x in place_m]
        truth = "where they end on this valve" if direction < 0.0 else None
        panel.plot(place_m * 1e3, truth_ma, "--", color=INK, linewidth=1.0, label=truth)
        landed = [each for each in belief.landings if each.direction == direction]
        panel.plot([1e3 * each.position_m for each in landed], [each.pressure_ma for each in landed], "o", color=colour)
    panel.set_ylim(1.0, 29.0)
    panel.legend(loc="upper left", fontsize=SMALL, frameon=False)
    dress(panel, grid="both")


def _words(valve: ValveParameters, belief: ValveBelief) -> str:
    gain, (_, _, _, static, lag, *_) = valve.force_gain_n_per_ma, belief.numbers.variances
    lag_ms, sigma_ms = 1e3 * belief.lag_s, 1e3 * (belief.lag_s + LEAST_LAG_S) * lag**0.5
    return (
        f"F_s {gain * belief.static_ma:.0f} ± {_SIGMAS * gain * static**0.5:.0f} N, "
        f"lag {lag_ms:.0f} ± {_SIGMAS * sigma_ms:.0f} ms"
    )


if __name__ == "__main__":
    draw(Path(sys.argv[1]))
