"""The cases of the robustness test: what a valve is, what its positioner is told, and its setpoints. Pure.

A case is one valve with some setpoints. It is drawn from the space by a scrambled Sobol sequence (Owen, 1998), one for
each class, so that every class is filled evenly, and a longer sequence begins with a shorter one. Setpoints, and the
seed of every noise, follow from the number of the case.

Classes:

- `as configured`: the positioner is told every parameter as it is.
- `within 20 %`: every parameter that it is told is 0.8 to 1.2 times the true one.
- `configured wrongly`: one or two of them are half to twice the true one, or configured and absent.
- `not configured`: one or two effects are there of which the positioner is told nothing.
- `beyond reach`: as configured, and setpoints that no current reaches.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, fields
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.stats import qmc

from plant_emulator.parameters import ValveSettings
from plant_emulator.presets import plant_settings
from positioner.bench.playable import restartable_mm

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from plant_emulator.parameters import PlantSettings
    from positioner.config.schema import Configuration
    from positioner.robustness.space import Space

AS_CONFIGURED, WITHIN, WRONGLY, NOT_CONFIGURED, BEYOND = CLASSES = (
    "as configured",
    "within 20 %",
    "configured wrongly",
    "not configured",
    "beyond reach",
)

ROOT = "paper"
"""The preset that is the nominal valve."""
_LOOP_MA = 16.0
"""From 4 to 20 mA."""
_LEAST_REACH = 0.25
"""Of the span: a valve with more friction than leaves this has less friction instead."""
_SMALLEST_REACH = 0.1
"""The same with every effect that the valve has."""
_SETTLED = 0.9
"""Friction, and what else cuts the reach, is made smaller by this factor until the stem has its reach."""

_OPTIONAL = ("lag_s", "converter_lag_s", "dead_time_s", "slew_ma_per_s", "sensor_lag_s", "backlash_of_span")
_TOLD = ("spring", "area", "bench_n", "static_n", "coulomb_n", "viscous", "noise_of_reading", *_OPTIONAL)
"""Everything that a positioner is told, with a ratio of its own where it is told nearly right."""
_MISTAKES = (
    "friction",
    "static_n",
    "coulomb_n",
    "spring",
    "area",
    "noise_of_reading",
    *_OPTIONAL,
    "friction nearly gone",
)
"""What a positioner may be told wrongly."""
_MISTAKES_ALONE = _MISTAKES[:-1]
"""Those that change nothing of the valve itself."""
_DRAWN = (
    *("spring_rate_n_per_m", "diaphragm_area_m2", "bench_set_n", "static_friction_n", "coulomb_friction_n"),
    *("viscous_friction_n_s_per_m", "initial_position_m"),
)
"""Keys of a plant's `[valve]` table that every case has of its own."""
_CUTTING = (
    "friction_by_place",
    "friction_by_direction",
    "friction_growth",
    "friction_scatter",
    "force_constant",
    "force_steps",
    "force_sine",
    "force_noise",
)
"""Effects that cut the reach."""
_NOISES = ("correlated_noise_s", "held_noise_s", "resolution_of_span")

Values = dict[str, float]
"""A valve as flat numbers, by the names of the space; what is absent is 0."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Base:
    """What is drawn around: the nominal valve, of which the space has multiples, or a valve that is configured.

    nominal: its parameters. own: the numbers of a configured valve, by the names of the space; None: the space has
    them. control: the `[control]` table of its positioner, and period_s its sample period.
    """

    nominal: PlantSettings
    own: Values | None = None
    control: Mapping[str, Any] = field(default_factory=dict)
    period_s: float | None = None
    plant: Mapping[str, Any] | None = None
    """The `[plant]` table of a given plant, which is the true one in every case; None: the true valve is drawn."""

    @property
    def tables(self) -> dict[str, Any]:
        """The parts of the `[plant]` table that no case changes."""
        valve = {name: value for name, value in asdict(self.nominal.valve).items() if name not in _DRAWN}
        return {"preset": ROOT, "valve": valve, "sensor": {"noise_of_span": self.nominal.sensor.noise_of_span}}

    @property
    def gain_pa_per_ma(self) -> float:
        """K_p."""
        return self.nominal.valve.pressure_gain_pa_per_ma

    def span_force_n(self, values: Values) -> float:
        """Return the force of 16 mA."""
        return _LOOP_MA * self.nominal.valve.diaphragm_area_m2 * values["area"] * self.gain_pa_per_ma


NOMINAL = Base(nominal=plant_settings(ROOT))


def base_of(configuration: Configuration) -> Base:
    """Return what is drawn around a user's own positioner: its valve is what the configuration says."""
    own, actuator, span_m = configuration.valve, configuration.valve.actuator, configuration.valve.span_m
    shared = {each.name for each in fields(ValveSettings)} & {each.name for each in fields(own)}
    valve = {name: getattr(own, name) for name in shared}
    middle_m = 0.5 * (own.travel_min_m + own.travel_max_m)
    sensor = {"noise_of_reading": 0.0, "noise_of_span": configuration.estimator.noise_of_span}
    nominal = plant_settings(ROOT, {"valve": {**valve, "initial_position_m": middle_m}, "sensor": sensor})
    lag_s = actuator.fill_time_constant_s
    values: Values = {
        "spring": 1.0,
        "area": 1.0,
        "viscous": 1.0,
        "friction": 0.0,
        "bench_n": own.bench_set_n,
        "static_n": own.static_friction_n,
        "coulomb_n": own.coulomb_friction_n,
        "noise_of_reading": configuration.estimator.noise_of_reading,
        "lag_s": lag_s,
        "vent_over_fill": actuator.vent_time_constant_s / lag_s if lag_s else 1.0,
        "converter_lag_s": actuator.converter_time_constant_s,
        "dead_time_s": actuator.dead_time_s,
        "slew_ma_per_s": actuator.slew_ma_per_s,
        "sensor_lag_s": own.sensor_time_constant_s,
        "backlash_of_span": own.backlash_m / span_m,
    }
    control = asdict(configuration.control)
    for name in ("law", "sample_period_s", "table_from_s"):
        control.pop(name, None)
    kept = {name: value for name, value in control.items() if value is not None}
    return Base(nominal=nominal, own=values, control=kept, period_s=configuration.control.sample_period_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One valve and its setpoints.

    group: its class, or the set that it belongs to. name: unique in its group; of a set what is special about it.
    true, told: the `[plant]` table of the emulated valve, and of the valve that the positioner believes in.
    optimal_moves: length of a dwell in units of the longest time-optimal move, where dwell_s is None.
    force_step_n: size of the steps of the process force, one in each dwell at a random instant; 0 is none.
    restart: whether a run before it has filled the stiction table. factors: what the case is binned by.
    skipped: dwells at the beginning that are not judged.
    """

    group: str
    name: str
    seed: int
    period_s: float
    setpoints_mm: tuple[float, ...]
    true: dict[str, Any]
    told: dict[str, Any]
    optimal_moves: float = 12.0
    dwell_s: float | None = None
    least_s: float = 1.2
    force_step_n: float = 0.0
    restart: bool = False
    skipped: int = 0
    factors: Mapping[str, float] = field(default_factory=dict)
    control: Mapping[str, Any] = field(default_factory=dict)
    """The `[control]` table of the judged law's positioner."""
    guard: Mapping[str, Any] = field(default_factory=dict)
    """The `[guard]` table of every positioner."""

    @property
    def label(self) -> str:
        """How a person names the case."""
        return f"{self.group}/{self.name}"


def drawn(space: Space, group: str, valves: int, seed: int, base: Base = NOMINAL) -> list[Case]:
    """Return the first `valves` cases of a class around `base`; the same from the same seed."""
    dimensions = _dimensions(space)
    chance = np.random.default_rng((seed, CLASSES.index(group)))
    sequence = qmc.Sobol(len(dimensions), seed=chance).random_base2(max(valves - 1, 0).bit_length())[:valves]
    return [
        _case(space, base, group, number, seed, dict(zip(dimensions, point, strict=True)))
        for number, point in enumerate(sequence.tolist())
    ]


def _dimensions(space: Space) -> tuple[str, ...]:
    present = [f"has {name}" for name in space.configurable]
    ratios = [f"ratio {name}" for name in _TOLD]
    picks = ["pick 1", "pick 2", "place 1", "place 2", "two", "absent 1", "absent 2", "wave"]
    return (*space.valve, *space.configurable, *present, *ratios, *picks, "moves")


def _case(space: Space, base: Base, group: str, number: int, seed: int, place: Mapping[str, float]) -> Case:
    chance = np.random.default_rng((seed, CLASSES.index(group), number))
    true = _valve(space, base, place)
    told = dict(true)
    factors: Values = {}
    if group == WITHIN:
        within = space.mistakes["within"]
        for name in _TOLD:
            told[name] = true[name] * within.at(place[f"ratio {name}"])
    elif group == WRONGLY:
        mistakes = _MISTAKES if base.plant is None else _MISTAKES_ALONE
        for which in _picks(place, len(mistakes)):
            absent = which[2] if base.plant is None else 1.0  # what a given plant has, it has
            factors |= _mistake(space, mistakes[which[0]], which[1], absent, true, told)
    elif group == NOT_CONFIGURED:
        effects = _effects(space, base, true)
        for which in _picks(place, len(effects)):
            given = base.plant is not None and effects[which[0]] in _OPTIONAL
            factors |= _unconfigured(space, effects[which[0]], which[1], place["wave"], true, told, given=given)
    told["coulomb_n"] = min(told["coulomb_n"], told["static_n"])
    true["coulomb_n"] = min(true["coulomb_n"], true["static_n"])
    if base.own is not None and base.plant is None:
        true, told = _as_configured(base.own, true, told)
    span_m = base.nominal.valve.span_m
    low_mm, high_mm = _given_reach(base, true)
    begin_mm, setpoints_mm = walk(space, chance, low_mm, high_mm, space.dwells, span_m)
    if base.plant is not None:
        begin_mm = base.nominal.valve.initial_position_m * 1e3
    if group == BEYOND:
        setpoints_mm = _beyond(base.nominal.valve, chance, setpoints_mm, low_mm, high_mm)
    told.update(dict.fromkeys(space.unmodelled, 0.0))
    drawn_of_all = (*space.valve, *space.configurable) if base.plant is None else ("period_s", "noise_of_reading")
    shared = {name: true[name] for name in drawn_of_all if true.get(name)}
    return Case(
        group=group,
        name=str(number),
        seed=int(chance.integers(1 << 31)),
        period_s=base.period_s or round(true["period_s"], 5),
        setpoints_mm=setpoints_mm,
        true=_tables(base, true, begin_mm) if base.plant is None else _given_tables(base.plant, true, span_m),
        told=_tables(base, told, begin_mm),
        optimal_moves=round(space.dwell.optimal_moves.at(place["moves"]), 2),
        dwell_s=7.0 if group == BEYOND else None,
        least_s=space.dwell.least_s,
        force_step_n=true["force_steps"] * base.span_force_n(true),
        control=base.control,
        factors={name: round(value, 6) for name, value in (shared | factors).items()},
    )


def _given_reach(base: Base, true: Values) -> tuple[float, float]:
    """Make what cuts the reach of a valve smaller until there is one, and return it in mm."""
    low_mm, high_mm = _reach_mm(base, true)
    while high_mm - low_mm < _SMALLEST_REACH * base.nominal.valve.span_m * 1e3:
        for name in ("static_n", "coulomb_n", *_CUTTING):
            true[name] *= _SETTLED
        true["supply_ma"] = 0.0
        low_mm, high_mm = _reach_mm(base, true)
    return low_mm, high_mm


def _as_configured(own: Values, true: Values, told: Values) -> tuple[Values, Values]:
    """Return the numbers of the true valve and of the told one, where the told one is a valve that is configured."""
    shifted = dict(true)
    for name in _TOLD:
        if told[name] and own[name]:
            shifted[name] = own[name] * true[name] / told[name]
        elif own[name]:  # configured, and absent
            shifted[name] = true[name]
        elif told[name]:  # a mistake about what this configuration does not have: it is as configured
            shifted[name] = own[name]
    shifted["coulomb_n"] = min(shifted["coulomb_n"], shifted["static_n"])
    shifted["vent_over_fill"] = own["vent_over_fill"] if own["lag_s"] else 1.0
    return shifted, {**told, **own}


def _valve(space: Space, base: Base, place: Mapping[str, float]) -> Values:
    """Return a valve that can be moved over a quarter of its span, or the configured one."""
    found: Values = dict.fromkeys(space.unmodelled, 0.0)
    found |= {name: factor.at(place[name]) for name, factor in space.valve.items()}
    found |= {
        name: factor.at(place[name]) if place[f"has {name}"] < factor.present else 0.0
        for name, factor in space.configurable.items()
    }
    found["vent_over_fill"] = space.configurable["vent_over_fill"].at(place["vent_over_fill"])
    if base.own is not None:
        return {**found, **base.own}
    found["bench_n"] = found["bench_set"] * base.span_force_n(found)
    while True:
        found["static_n"] = found["friction"] * base.span_force_n(found)
        found["coulomb_n"] = found["sliding"] * found["static_n"]
        low_mm, high_mm = _reach_mm(base, found)
        if high_mm - low_mm >= _LEAST_REACH * base.nominal.valve.span_m * 1e3:
            return found
        found["friction"] *= _SETTLED


def _picks(place: Mapping[str, float], count: int) -> Iterator[tuple[int, float, float]]:
    """Yield one or two different choices out of `count`: number, place of its size, place of its kind."""
    first = int(place["pick 1"] * count)
    yield first, place["place 1"], place["absent 1"]
    if place["two"] < 0.5:  # noqa: PLR2004 - half of the valves
        yield (first + 1 + int(place["pick 2"] * (count - 1))) % count, place["place 2"], place["absent 2"]


def _mistake(space: Space, name: str, size: float, kind: float, true: Values, told: Values) -> Values:
    """Change what the positioner is told about `name`, and return the factor: configured over true."""
    if name == "friction nearly gone":
        ratio = space.mistakes["friction_nearly_gone"].at(size)
        for each in ("static_n", "coulomb_n"):
            true[each] = told[each] * ratio
        return {"true over configured friction": ratio}
    if name in _OPTIONAL and (true[name] == 0.0 or kind < 0.5):  # noqa: PLR2004 - half are absent
        true[name], told[name] = 0.0, space.configurable[name].at(size)
        told["vent_over_fill"] = 1.0 if name == "lag_s" else told["vent_over_fill"]
        return {f"{name} configured and absent": told[name]}
    ratio = space.mistakes["wrong_spring_or_area" if name in ("spring", "area") else "wrong"].at(size)
    for each in ("static_n", "coulomb_n") if name == "friction" else (name,):
        told[each] = true[each] * ratio
    if name == "static_n":  # F_c is never above F_s
        told["static_n"] = max(told["static_n"], told["coulomb_n"])
    return {f"{name.removesuffix('_n')}: configured over true": ratio}


def _effects(space: Space, base: Base, true: Values) -> tuple[str, ...]:
    """Return what a positioner may be told nothing of; of a given plant what it has, and kinds of noise."""
    if base.plant is not None:
        return (*(name for name in _OPTIONAL if true[name] > 0.0), *_NOISES)
    return (*_OPTIONAL, *(name for name in space.unmodelled if name != "force_sine_hz"))


def _unconfigured(
    space: Space, name: str, size: float, wave: float, true: Values, told: Values, *, given: bool
) -> Values:
    """Give the valve an effect of which the positioner is told nothing, and return the factor.

    given: the valve has the effect already.
    """
    factor = space.configurable.get(name) or space.unmodelled[name]
    if not given:
        true[name] = factor.at(size)
    if name in space.configurable:
        told[name] = 0.0
    if name in _NOISES:  # one kind of noise; σ stays
        true.update({other: 0.0 for other in _NOISES if other != name})
    if name == "force_sine":
        true["force_sine_hz"] = space.unmodelled["force_sine_hz"].at(wave)
    return {f"{name}, not configured": true[name]}


def _tables(base: Base, values: Values, begin_mm: float) -> dict[str, Any]:
    """Return the `[plant]` table of a valve."""
    valve, force_n = base.nominal.valve, base.span_force_n(values)
    span_m, gain, fixed = valve.span_m, base.gain_pa_per_ma, base.tables
    return {
        "preset": ROOT,
        "valve": {
            **fixed["valve"],
            "spring_rate_n_per_m": values["spring"] * valve.spring_rate_n_per_m,
            "diaphragm_area_m2": values["area"] * valve.diaphragm_area_m2,
            "bench_set_n": values["bench_n"],
            "static_friction_n": values["static_n"],
            "coulomb_friction_n": values["coulomb_n"],
            "viscous_friction_n_s_per_m": values["viscous"] * valve.viscous_friction_n_s_per_m,
            "initial_position_m": begin_mm * 1e-3,
        },
        "actuator": {
            "fill_time_constant_s": values["lag_s"],
            "vent_time_constant_s": values["lag_s"] * values["vent_over_fill"],
            "dead_time_s": values["dead_time_s"],
            "converter_time_constant_s": values["converter_lag_s"],
            "slew_pa_per_s": values["slew_ma_per_s"] * gain,
            "hysteresis_ma": values["hysteresis_ma"],
            "supply_pa": values["supply_ma"] * gain,
        },
        "process": {
            "force_n": values["force_constant"] * force_n,
            "noise_n": values["force_noise"] * force_n,
            "sine_n": values["force_sine"] * force_n,
            "sine_hz": values["force_sine_hz"] or 1.0,
        },
        "packing": {
            "growth_per_decade": values["friction_growth"],
            "drift_per_move": values["wear_per_move"],
            "place_fraction": values["friction_by_place"],
            "direction_fraction": values["friction_by_direction"],
        },
        "stochastic": {"friction_fraction": values["friction_scatter"]},
        "sensor": {
            **fixed["sensor"],
            "backlash_m": values["backlash_of_span"] * span_m,
            "time_constant_s": values["sensor_lag_s"],
            "noise_of_reading": values["noise_of_reading"],
            "noise_correlation_s": values["correlated_noise_s"],
            "noise_hold_s": values["held_noise_s"],
            "resolution_m": values["resolution_of_span"] * span_m,
        },
    }


def _given_tables(plant: Mapping[str, Any], values: Values, span_m: float) -> dict[str, Any]:
    """Return the `[plant]` table of a given plant: its own, with the noise that is drawn."""
    sensor = dict(plant.get("sensor", {})) | {"noise_of_reading": values["noise_of_reading"]}
    if any(values[name] for name in _NOISES):  # one kind of noise
        sensor |= {
            "noise_correlation_s": values["correlated_noise_s"],
            "noise_hold_s": values["held_noise_s"],
            "resolution_m": values["resolution_of_span"] * span_m,
        }
    return {**plant, "sensor": sensor}


def _reach_mm(base: Base, values: Values) -> tuple[float, float]:
    """Return the range in mm from which the stem can be moved both ways, whatever the force does meanwhile."""
    middle_mm = 500.0 * (base.nominal.valve.travel_min_m + base.nominal.valve.travel_max_m)
    settings = plant_settings(overrides=_tables(base, values, middle_mm))
    low_mm, high_mm = restartable_mm(settings)
    force_n = base.span_force_n(values) * (
        values["force_steps"] + values["force_sine"] + 3.0 * values["force_noise"]
    )  # three standard deviations
    uneven_n = values["static_n"] * (
        values["friction_by_place"] + values["friction_by_direction"] + 3.0 * values["friction_growth"]
    )  # three decades of seconds
    spare_mm = 1e3 * (force_n + uneven_n) / settings.valve.spring_rate_n_per_m
    return low_mm + spare_mm, high_mm - spare_mm


def walk(
    space: Space, chance: np.random.Generator, low_mm: float, high_mm: float, dwells: int, span_m: float
) -> tuple[float, tuple[float, ...]]:
    """Return a place in mm to begin at, and setpoints from low_mm to high_mm, a random step from each to the next."""
    span_mm, own = span_m * 1e3, space.dwell
    begin_mm = here_mm = round(low_mm + (high_mm - low_mm) * chance.random(), 3)
    found: list[float] = []
    while len(found) < dwells:
        sizes = own.small if chance.random() < own.small_share else own.large
        step_mm = sizes.at(chance.random()) * span_mm * (1.0 if chance.random() < 0.5 else -1.0)  # noqa: PLR2004
        for next_mm in (here_mm + step_mm, here_mm - step_mm):
            if low_mm <= next_mm <= high_mm:
                here_mm = round(min(max(next_mm, low_mm), high_mm), 3)
                found.append(here_mm)
                break
    return begin_mm, tuple(found)


def _beyond(
    valve: ValveSettings, chance: np.random.Generator, inside_mm: tuple[float, ...], low_mm: float, high_mm: float
) -> tuple[float, ...]:
    """Return setpoints of which every second one lies 3 to 30 % of the span beyond the reach, inside the travel."""
    found: list[float] = []
    for number, setpoint_mm in enumerate(inside_mm):
        if number % 2 == 0:
            found.append(setpoint_mm)
            continue
        beyond_mm = valve.span_m * 1e3 * (0.03 + 0.27 * chance.random())
        sides_mm = [high_mm + beyond_mm, low_mm - beyond_mm]
        if chance.random() < 0.5:  # noqa: PLR2004 - either side
            sides_mm.reverse()
        inside = [each for each in sides_mm if valve.travel_min_m * 1e3 < each < valve.travel_max_m * 1e3]
        found.append(round(inside[0], 3) if inside else setpoint_mm)
    return tuple(found)
