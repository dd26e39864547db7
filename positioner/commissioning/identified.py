"""The result of an identification: each parameter with its 95 % interval, and the keys that hold it. Pure."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from positioner.commissioning.explained import Part
    from positioner.valve.parameters import ValveParameters


@dataclass(frozen=True, slots=True)
class Interval:
    """A value and its 95 % interval; `seen` is false where the experiment could not show it: it is the believed one."""

    value: float
    low: float
    high: float
    seen: bool = True

    def contains(self, truth: float) -> bool:
        """Whether the interval contains a value."""
        return self.low <= truth <= self.high


@dataclass(frozen=True, slots=True)
class IdentifiedValve:
    """What the experiment of `identify` showed, in SI units.

    friction_scatter: of the friction between slips, as a part of it (standard deviation).
    noise_correlation: 1 for white noise, more where neighbouring readings are alike.
    breakaways, steps: how many of each could be used.
    misfit, step_misfit: mean square of the weighted residuals, of all and of the steps; 1 in a perfect fit.
    parts: the residuals by what the stem did.
    """

    spring_rate_n_per_m: Interval
    bench_set_n: Interval
    static_friction_n: Interval
    coulomb_friction_n: Interval
    viscous_friction_n_s_per_m: Interval
    stribeck_velocity_m_per_s: Interval
    fill_time_constant_s: Interval
    vent_time_constant_s: Interval
    dead_time_s: Interval
    noise_of_reading: Interval
    noise_of_span: Interval
    friction_scatter: float
    noise_correlation: float
    breakaways: int
    steps: int
    misfit: float
    step_misfit: float
    parts: tuple[Part, ...] = ()

    @property
    def unexplained(self) -> tuple[Part, ...]:
        """The parts of the record that this valve does not explain: with any of them it is no result."""
        return tuple(each for each in self.parts if not each.explained)

    def tables(self) -> dict[str, dict[str, Any]]:
        """Return the values by table and key of a configuration; what could not be seen is left out."""
        valve = (
            "spring_rate_n_per_m",
            "bench_set_n",
            "static_friction_n",
            "coulomb_friction_n",
            "viscous_friction_n_s_per_m",
            "stribeck_velocity_m_per_s",
        )
        actuator = ("fill_time_constant_s", "vent_time_constant_s", "dead_time_s")
        estimator = ("noise_of_reading", "noise_of_span")
        return {
            "valve": self._values(valve),
            "valve.actuator": self._values(actuator),
            "estimator": self._values(estimator),
        }

    def _values(self, names: tuple[str, ...]) -> dict[str, float]:
        found: dict[str, Interval] = {name: getattr(self, name) for name in names}
        return {name: each.value for name, each in found.items() if each.seen}

    def laid_over(self, valve: ValveParameters) -> ValveParameters:
        """Return the believed valve with the identified values in place of its own."""
        tables = self.tables()
        return replace(valve, **tables["valve"], actuator=replace(valve.actuator, **tables["valve.actuator"]))
