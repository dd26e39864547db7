"""Conditions of the league on real valves: what the plant is, and what is configured of it, by name. Pure.

`as configured` is the main part of the league. Every other condition changes one thing about the nominal valve; where
that is not configured, the positioner has the parameters of the valve without that change.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from positioner.studies.real_valves.valves import lag_table

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

AS_CONFIGURED = "as configured"
TYPICAL_S = (0.01, 0.1)
"""Lags at which most conditions are played."""

_PA_PER_MA = 5171.06775
"""K_p of the nominal valve."""
_NOT_CONFIGURED = "not configured: lag ± 30 %, vent 0.6 of fill, one sample of dead time"


def _nothing(_lag_s: float) -> dict[str, Any]:
    return {}


@dataclass(frozen=True, slots=True, kw_only=True)
class Condition:
    """One condition.

    true, believed: changes of the `[plant]` table, given the lag; `believed` makes the plant whose parameters the
        positioner has, `true` the one that it controls. The sensor's noise is configured as the league's noise says.
    lags_s: the lags at which it is played. period_s, dwell_s: other ones than the league's.
    goal: several conditions of the same goal; else the text is its name.
    goal_pct: the limit of the mean error, for each noise at which the goal holds.
    skipped: dwells at the beginning that are not judged. setpoints: how many of the eight are visited.
    """

    text: str
    goal: str = ""
    true: Callable[[float], Mapping[str, Any]] = _nothing
    believed: Callable[[float], Mapping[str, Any]] = _nothing
    lags_s: tuple[float, ...] = TYPICAL_S
    goal_pct: Mapping[str, float]
    period_s: float | None = None
    dwell_s: float | None = None
    skipped: int = 0
    setpoints: int = 8


def _actuator(**values: float) -> Callable[[float], dict[str, Any]]:
    return lambda _lag_s: {"actuator": values}


def _sensor(**values: float) -> Callable[[float], dict[str, Any]]:
    return lambda _lag_s: {"sensor": values}


def _lag_times(fill: float, vent: float) -> Callable[[float], dict[str, Any]]:
    return lambda lag_s: {"actuator": {"fill_time_constant_s": fill * lag_s, "vent_time_constant_s": vent * lag_s}}


def _configured(text: str, change: Callable[[float], Mapping[str, Any]], goal_pct: float) -> Condition:
    """Return the condition of a change that the positioner knows."""
    return Condition(text=text, true=change, believed=change, goal_pct={"0.05": goal_pct})


def _not_configured(text: str, change: Callable[[float], Mapping[str, Any]]) -> Condition:
    """Return the condition of a change that the positioner does not know."""
    return Condition(text=text, goal=_NOT_CONFIGURED, true=change, goal_pct={"0.05": 0.06})


def _no_lag(_lag_s: float) -> dict[str, Any]:
    return {"actuator": lag_table(0.0)}


def _other_noise(of_reading: float, period_s: float) -> Condition:
    """Return the condition of a sensor with less noise than the 2 % of its reading that is configured."""
    return Condition(
        text=f"noise configured 2 %, true {of_reading * 100.0:g} %, T_s {period_s * 1e3:g} ms",
        goal="noise configured 2 %, true 0 to 2 %, T_s 1 to 20 ms, from the sixth dwell",
        true=_sensor(noise_of_reading=of_reading),
        lags_s=(0.0, 0.02),
        goal_pct={"2": 0.10},
        period_s=period_s,
        skipped=5,
    )


def _all() -> dict[str, Condition]:
    found = {
        "lag+30-not-configured": _not_configured("lag 30 % longer than configured", _lag_times(1.3, 1.3)),
        "lag-30-not-configured": _not_configured("lag 30 % shorter than configured", _lag_times(0.7, 0.7)),
        "vent-0.6-not-configured": _not_configured("vents in 0.6 of the configured time", _lag_times(1.0, 0.6)),
        "dead-time-1-not-configured": _not_configured(
            "a dead time of one sample, not configured", _actuator(dead_time_s=0.001)
        ),
        "supply-17": Condition(
            text="an air supply that ends at 17 mA",
            true=_actuator(supply_pa=17.0 * _PA_PER_MA),
            goal_pct={"0.05": 0.06},
        ),
        "growing-friction": Condition(
            text="static friction that grows at rest by 10 % in a decade",
            true=lambda _lag_s: {"packing": {"growth_per_decade": 0.1}},
            goal_pct={"0.05": 0.06},
        ),
        "dead-time-10": _configured("dead time 10 ms", _actuator(dead_time_s=0.01), 0.06),
        "dead-time-30": _configured("dead time 30 ms", _actuator(dead_time_s=0.03), 0.15),
        "converter-5": _configured("I/P lag 5 ms", _actuator(converter_time_constant_s=0.005), 0.06),
        "converter-20": _configured("I/P lag 20 ms", _actuator(converter_time_constant_s=0.02), 0.06),
        "sensor-lag-2": _configured("sensor lag 2 ms", _sensor(time_constant_s=0.002), 0.10),
        "sensor-lag-20": _configured("sensor lag 20 ms", _sensor(time_constant_s=0.02), 0.10),
        # half the play is the error that no law can see
        "backlash-0.1": _configured("backlash 0.1 % of span", _sensor(backlash_m=0.000127), 0.10),
        "backlash-0.5": _configured("backlash 0.5 % of span", _sensor(backlash_m=0.000635), 0.30),
        "slew-40": _configured("slew limit 40 mA/s", _actuator(slew_pa_per_s=40.0 * _PA_PER_MA), 0.06),
        "dead-time-converter-slew": _configured(
            "dead time 3 ms, I/P lag 8 ms and slew limit 77 mA/s",
            _actuator(dead_time_s=0.003, converter_time_constant_s=0.008, slew_pa_per_s=77.0 * _PA_PER_MA),
            0.06,
        ),
        "lag-not-configured": Condition(
            text="no lag configured, true lag up to 2 ms",
            believed=_no_lag,
            lags_s=(0.0005, 0.001, 0.002),
            goal_pct={"0.05": 0.10, "2": 0.15},
        ),
        "period-10": Condition(text="T_s 10 ms", lags_s=(0.0, 0.01, 0.1), goal_pct={"0.05": 0.05}, period_s=0.01),
        "lag-1000": Condition(text="lag 1 s", lags_s=(1.0,), goal_pct={"0.05": 0.08}, dwell_s=40.0, setpoints=4),
    }
    for percent in (0.0, 0.5, 1.0, 2.0):
        for period_ms in (1, 5, 20):
            name = f"noise-{percent:g}-period-{period_ms}"
            found[name] = _other_noise(percent / 100.0, period_ms / 1e3)
    return found


CONDITIONS: Mapping[str, Condition] = MappingProxyType(_all())
