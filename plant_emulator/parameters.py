"""The parameters of a plant, with their limits. Pure.

SI units; mA for the loop current. The limits are wide enough for any control valve, and narrow enough to catch a wrong
unit or decimal point, such as a mass of 1361 kg.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from enum import StrEnum
from typing import Annotated, Any

from annotated_types import Interval

from plant_emulator.chamber_settings import ChamberSettings
from plant_emulator.friction_settings import FrictionModel, FrictionSettings
from plant_emulator.sensor_settings import SensorSettings
from positioner.inputs.nearest import nearest
from positioner.inputs.table import SettingsTable

_LOWEST_RATE_N_PER_M = 100.0
_GEOMETRY = ("travel_min_m", "travel_max_m", "span_m", "initial_position_m", "double_acting")


class FailPosition(StrEnum):
    """The place to which the emulated I/P converter takes the valve when no commands come."""

    CLOSE = "close"
    OPEN = "open"
    HOLD = "hold"
    CURRENT = "current"


@dataclass(frozen=True, slots=True, kw_only=True)
class ValveSettings(SettingsTable):
    """Stem, spring, packing and diaphragm (paper Table 3); the travel is bounded by two inelastic stops."""

    mass_kg: Annotated[float, Interval(ge=0.01, le=200.0)]
    """m, moving mass."""
    diaphragm_area_m2: Annotated[float, Interval(ge=1e-4, le=2.0)]
    """S_a, effective area of the diaphragm."""
    pressure_gain_pa_per_ma: Annotated[float, Interval(ge=100.0, le=1e5)]
    """K_p of eq. 10, pressure per mA behind the I/P converter."""
    spring_rate_n_per_m: Annotated[float, Interval(ge=100.0, le=1e8)]
    """K_m, rate of the actuator's spring."""
    static_friction_n: Annotated[float, Interval(ge=0.0, le=1e5)]
    """F_s; with 0 the valve has only viscous friction, and no zero-speed band."""
    coulomb_friction_n: Annotated[float, Interval(ge=0.0, le=1e5)]
    """F_c, at most F_s."""
    viscous_friction_n_s_per_m: Annotated[float, Interval(ge=0.0, le=1e7)]
    """F_v, friction that grows with the speed."""
    stribeck_velocity_m_per_s: Annotated[float, Interval(ge=1e-6, le=0.1)]
    """V_s, the speed at which the friction falls from F_s to F_c."""
    stick_velocity_m_per_s: Annotated[float, Interval(ge=1e-7, le=0.01)]
    """DV, half the width of Karnopp's zero-speed band."""
    travel_min_m: Annotated[float, Interval(ge=-1.0, le=1.0)] = 0.0
    """The lower stop."""
    travel_max_m: Annotated[float, Interval(ge=-1.0, le=1.0)] = 0.1397
    """The upper stop."""
    bench_set_n: Annotated[float, Interval(ge=-1e5, le=1e5)] = 0.0
    """Force of the spring's preload at position 0."""
    span_m: Annotated[float, Interval(ge=1e-3, le=1.0)] = 0.127
    """Travel that counts as 100 %."""
    initial_position_m: Annotated[float, Interval(ge=-1.0, le=1.0)] = 0.01
    """Where the stem rests at the start."""

    def __post_init__(self) -> None:
        """Check the relations between parameters.

        Raises:
            ValueError: F_c above F_s, no travel between the stops, or a start beyond them.
        """
        if self.coulomb_friction_n > self.static_friction_n:
            raise ValueError("coulomb_friction_n must not be above static_friction_n")
        if self.travel_min_m >= self.travel_max_m:
            raise ValueError("travel_min_m must be below travel_max_m")
        if not self.travel_min_m <= self.initial_position_m <= self.travel_max_m:
            raise ValueError("initial_position_m must be from travel_min_m to travel_max_m")


class ActuatorModel(StrEnum):
    """The equations of the pressure in the chamber."""

    LAG = "lag"
    MASS_FLOW = "mass-flow"


@dataclass(frozen=True, slots=True, kw_only=True)
class ActuatorSettings(SettingsTable):
    """I/P converter, air line and chamber; all 0 is eq. 10 (P = K_p·u at once).

    The current passes the dead time, then the converter's offset, play, dead band, supply limit and lag, then the
    chamber: its slew limit and lag, or with `model = "mass-flow"` the flow of air through a spool into its volume.
    """

    model: ActuatorModel = ActuatorModel.LAG
    """"lag", or "mass-flow": `[chamber]` fills and vents through ISO 6358 orifices, and grows with the stem."""
    fill_time_constant_s: Annotated[float, Interval(ge=0.0, le=60.0)] = 0.0
    """Lag while the pressure rises."""
    vent_time_constant_s: Annotated[float, Interval(ge=0.0, le=60.0)] = 0.0
    """Lag while the pressure falls."""
    dead_time_s: Annotated[float, Interval(ge=0.0, le=10.0)] = 0.0
    """From a command until the I/P converter begins to follow it."""
    converter_time_constant_s: Annotated[float, Interval(ge=0.0, le=10.0)] = 0.0
    """Lag of the I/P converter, before that of the chamber."""
    slew_pa_per_s: Annotated[float, Interval(ge=0.0, le=1e9)] = 0.0
    """Highest rate of the pressure in the chamber, up and down; 0 is no limit."""
    offset_ma: Annotated[float, Interval(ge=-5.0, le=5.0)] = 0.0
    """Added to the current by the I/P converter."""
    hysteresis_ma: Annotated[float, Interval(ge=0.0, le=5.0)] = 0.0
    """Full width of the play of the I/P converter."""
    dead_band_ma: Annotated[float, Interval(ge=0.0, le=5.0)] = 0.0
    """A change of the current by less than this does not pass the I/P converter."""
    supply_pa: Annotated[float, Interval(ge=0.0, le=2e6)] = 0.0
    """Highest pressure of the I/P converter; 0 is no limit. With `mass-flow` it fills the chamber."""

    def __post_init__(self) -> None:
        """Check that a chamber with mass flow has a supply, and no lag beside it.

        Raises:
            ValueError: it has no supply, or a lag or a slew limit.
        """
        if self.model is not ActuatorModel.MASS_FLOW:
            return
        if self.supply_pa <= 0.0:
            raise ValueError("model = 'mass-flow' needs a supply_pa above 0: the air must come from somewhere")
        if self.fill_time_constant_s > 0.0 or self.vent_time_constant_s > 0.0 or self.slew_pa_per_s > 0.0:
            keys = "fill_time_constant_s, vent_time_constant_s and slew_pa_per_s"
            raise ValueError(f"model = 'mass-flow' makes its own lag of conductance and volume: leave {keys} 0")


@dataclass(frozen=True, slots=True, kw_only=True)
class ProcessSettings(SettingsTable):
    """Force of the process on the plug, against opening."""

    force_n: Annotated[float, Interval(ge=-1e5, le=1e5)] = 0.0
    """Constant part: the force at position 0."""
    gradient_n_per_m: Annotated[float, Interval(ge=-1e7, le=1e7)] = 0.0
    """Growth with the position; with the spring rate it must stay above 0."""
    noise_n: Annotated[float, Interval(ge=0.0, le=1e5)] = 0.0
    """Root mean square of the Gaussian noise."""
    noise_bandwidth_hz: Annotated[float, Interval(ge=0.01, le=1e3)] = 10.0
    """Corner frequency of the noise."""
    sine_n: Annotated[float, Interval(ge=0.0, le=1e5)] = 0.0
    """Amplitude of a part that swings as a sine, such as a slow wave of the flow."""
    sine_hz: Annotated[float, Interval(ge=1e-3, le=100.0)] = 0.2
    """Frequency of the sine; its phase is 0 at the plant's start."""

    @property
    def is_disturbed(self) -> bool:
        """Whether the force changes by itself."""
        return self.noise_n > 0.0 or self.sine_n > 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class PackingSettings(SettingsTable):
    """How the dry friction of the packing changes with rest, moves and time."""

    growth_per_decade: Annotated[float, Interval(ge=0.0, le=2.0)] = 0.0
    """Growth of F_s at rest, as a fraction of F_s, by each decade of 1 s + the time of rest."""
    creep_fraction: Annotated[float, Interval(ge=0.0, le=2.0)] = 0.0
    """Growth of F_s soon after a stop, as a fraction of F_s."""
    creep_time_constant_s: Annotated[float, Interval(ge=1e-3, le=1e5)] = 1.0
    """Time in which F_s creeps to it."""
    friction_factor: Annotated[float, Interval(ge=0.0, le=100.0)] = 1.0
    """Of F_s and F_c: 2 is a packing drawn too tight, 0.5 a loose one, 100 a stem that sticks fast."""
    drift_per_move: Annotated[float, Interval(ge=-0.1, le=0.1)] = 0.0
    """Change of F_s and F_c by each stop, as a fraction of both at the start; a scheduled one acts from then on."""
    drift_per_hour: Annotated[float, Interval(ge=-100.0, le=100.0)] = 0.0
    """Change of F_s and F_c by time, as a fraction of both at the start; it shows at the next stop."""
    place_fraction: Annotated[float, Interval(ge=0.0, le=0.9)] = 0.0
    """Amplitude of a wave of F_s and F_c along the travel, as a fraction of both."""
    direction_fraction: Annotated[float, Interval(ge=0.0, le=0.9)] = 0.0
    """Amplitude of a wave by which friction is larger one way and smaller the other, as a fraction of F_s."""
    place_period_m: Annotated[float, Interval(ge=1e-3, le=1.0)] = 0.02
    """Length of both waves; the second one is a quarter ahead."""

    @property
    def varies_by_place(self) -> bool:
        """Whether one of the waves is there."""
        return self.place_fraction > 0.0 or self.direction_fraction > 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class StochasticSettings(SettingsTable):
    """Friction that varies: one half of the variation follows the position, the other is random at every stop."""

    friction_fraction: Annotated[float, Interval(ge=0.0, le=0.9)] = 0.0
    """Largest deviation of F_s and F_c, as a fraction of each."""


_CHANGEABLE: dict[str, Any] = {
    "valve": ValveSettings,
    "actuator": ActuatorSettings,
    "chamber": ChamberSettings,
    "process": ProcessSettings,
    "sensor": SensorSettings,
    "packing": PackingSettings,
    "stochastic": StochasticSettings,
}

_BESIDE_OWN_PHYSICS = ("sensor.zero_m", "sensor.noise_of_reading", "sensor.noise_of_span", "sensor.resolution_m")
"""What may change in a plant with its own physics: it acts on the reading."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ScheduledChange(SettingsTable):
    """A parameter of the plant that changes while it runs, such as a fault; one `[[schedule]]` table."""

    at_s: Annotated[float, Interval(ge=0.0, le=1e9)]
    """Plant time at which the change begins."""
    key: str
    """The parameter with its table, such as "valve.static_friction_n"."""
    value: float | None = None
    """The new value; either this or the factor."""
    factor: float | None = None
    """The new value as a multiple of the one before."""
    over_s: Annotated[float, Interval(ge=0.0, le=1e9)] = 0.0
    """Duration of the change: a drift, in 100 equal steps; 0 is a sudden one."""

    def __post_init__(self) -> None:
        """Check that the key may change.

        Raises:
            ValueError: it is not in one of the tables that act, or is part of the geometry; not one new value.
        """
        table, _, name = self.key.partition(".")
        if table not in _CHANGEABLE or name in _GEOMETRY or "." in name:
            raise ValueError(f"key '{self.key}' cannot change; name one such as valve.static_friction_n")
        names = [each.name for each in fields(_CHANGEABLE[table])]
        if name not in names:
            raise ValueError(f"key '{self.key}': no such key; {nearest(name, names)}")
        if (self.value is None) == (self.factor is None):
            raise ValueError(f"change of {self.key}: give either its value or a factor")


@dataclass(frozen=True, slots=True, kw_only=True)
class PlantSettings(SettingsTable):
    """One emulated valve; `preset` names the settings on which the others are based."""

    preset: str | None = None
    """The plant on which this one is based: `plant-emulator presets` lists them."""
    physics: str | None = None
    """Physics of your own in place of the emulator's: FILE.py:NAME, beside this file if it is relative, or an installed
    plant. `[valve]`, `[actuator]`, lag and backlash of the `[sensor]` are then what a positioner is told."""
    valve: ValveSettings
    actuator: ActuatorSettings = field(default_factory=ActuatorSettings)
    chamber: ChamberSettings = field(default_factory=ChamberSettings)
    process: ProcessSettings = field(default_factory=ProcessSettings)
    sensor: SensorSettings = field(default_factory=SensorSettings)
    packing: PackingSettings = field(default_factory=PackingSettings)
    stochastic: StochasticSettings = field(default_factory=StochasticSettings)
    friction: FrictionSettings = field(default_factory=FrictionSettings)
    schedule: tuple[ScheduledChange, ...] = ()
    fail_position: FailPosition = FailPosition.CLOSE
    """Where the valve goes when no commands come."""
    fail_current_ma: Annotated[float, Interval(ge=0.0, le=25.0)] = 4.0
    """The current of `fail_position = "current"`."""
    deadman_s: Annotated[float, Interval(ge=0.001, le=60.0)] = 0.1
    """Age of the last command at which the valve goes to its `fail_position`."""

    def __post_init__(self) -> None:
        """Check the relation between the process and the spring, the friction model, and the order of the changes.

        Raises:
            ValueError: the process is stronger than the spring, two changes of one parameter overlap, the friction
                model lacks something, a second chamber stands beside a lag, or physics of one's own beside effects of
                the emulator's.
        """
        if self.physics is not None:
            self._check_own_physics()
        if self.chamber.double_acting and self.actuator.model is not ActuatorModel.MASS_FLOW:
            raise ValueError("chamber.double_acting needs [actuator] model = 'mass-flow': a lag has no chambers")
        if self.friction.model is not FrictionModel.KARNOPP:
            self._check_elastic_contact()
        ends_s: dict[str, float] = {}
        for change in sorted(self.schedule, key=lambda each: each.at_s):
            until_s = ends_s.get(change.key, 0.0)
            if change.at_s < until_s:
                raise ValueError(f"schedule at {change.at_s:g} s: {change.key} still changes until {until_s:g} s")
            ends_s[change.key] = change.at_s + change.over_s
        if self.valve.spring_rate_n_per_m + self.process.gradient_n_per_m < _LOWEST_RATE_N_PER_M:
            least = _LOWEST_RATE_N_PER_M - self.valve.spring_rate_n_per_m
            raise ValueError(f"process.gradient_n_per_m must be at least {least:g}: else the spring holds no position")

    def _check_elastic_contact(self) -> None:
        model = self.friction.model
        if self.valve.coulomb_friction_n <= 0.0:
            raise ValueError(f"friction.model = '{model}' needs a valve.coulomb_friction_n above 0")
        if self.packing.growth_per_decade > 0.0 or self.packing.creep_fraction > 0.0:
            keys = "packing.growth_per_decade and packing.creep_fraction"
            raise ValueError(f"friction.model = '{model}' knows no growth of F_s: leave {keys} 0")

    def _check_own_physics(self) -> None:
        """Refuse what acts in the emulator's physics alone.

        Raises:
            ValueError: such a table, key or change is given.
        """
        acting = {
            "friction": self.friction,
            "chamber": self.chamber,
            "process": self.process,
            "packing": self.packing,
            "stochastic": self.stochastic,
        }
        for name, table in acting.items():
            if table != type(table)():
                raise ValueError(f"[{name}] does not act on a plant with its own physics: leave it out")
        if self.sensor.reports_pressure:
            raise ValueError("sensor.reports_pressure: a plant with its own physics has no pressure: leave it out")
        for change in self.schedule:
            if change.key not in _BESIDE_OWN_PHYSICS:
                known = ", ".join(_BESIDE_OWN_PHYSICS)
                raise ValueError(f"schedule: {change.key} does not act on a plant with its own physics; {known} do")
