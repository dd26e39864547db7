"""Scenarios: the input of a bench run, a TOML file with a name. Shell, because it reads files.

The tables `[plant]`, `[valve]`, `[control]`, `[estimator]`, `[guard]` and `[wire]` are not read here: the plant
emulator and the daemon check their own keys.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field, replace
from importlib import resources
from pathlib import Path
from typing import Annotated, Any

from annotated_types import Interval, Len

from plant_emulator.plants import with_physics_in
from positioner.errors import ConfigurationError
from positioner.inputs import toml_reader
from positioner.inputs.nearest import check_name
from positioner.inputs.plug_in import anchored
from positioner.inputs.table import SettingsTable
from positioner.inputs.toml_lines import problem_at
from positioner.wire.file import wire_table

_MULTIPLES = (
    ("setpoint_period_s", "sample_period_s"),
    ("dwell_s", "setpoint_period_s"),
)
"""The first of each pair is a whole multiple of the second: every new setpoint then coincides with a sample."""

MOST_SAMPLES_PER_SETPOINT = 60
"""In lockstep the host sends setpoints for so many samples ahead: a raw CAN socket holds 278 frames, three a sample."""

_OWN_KEYS = ("law", "sample_period_s")
"""Keys of `[control]` that a scenario has itself: there they would contradict it."""

_MULTIPLE_TOLERANCE = 1e-9
"""Relative; decimal fractions such as 0.01 / 0.0001 are not exact in binary."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenario(SettingsTable):
    """One bench run: plant, law, setpoints, their duration, and the seed."""

    name: Annotated[str, Len(1, 40)]
    """Its name in reports and pictures."""
    title: Annotated[str, Len(1, 80)]
    """Its heading."""
    description: str = ""
    """A longer explanation."""
    law: Annotated[str, Len(1)] = "paper"
    """The control law of the daemon: its name, or FILE.py:NAME."""
    seed: Annotated[int, Interval(ge=0, le=2**32 - 1)] = 1
    """Of every random number: the same seed gives the same run in lockstep."""
    sample_period_s: Annotated[float, Interval(ge=1e-4, le=0.1)] = 0.001
    """Period of the plant's position frames and of the control cycle, T_s of the paper."""
    setpoint_period_s: Annotated[float, Interval(ge=1e-3, le=1.0)] = 0.01
    """Period of the host's setpoint frames; a whole multiple of `sample_period_s`, at most 60 of it."""
    setpoints_mm: Annotated[tuple[Annotated[float, Interval(ge=0.0, le=661.0)], ...], Len(1)]
    """Setpoints of one visit, in order; the upper limit is the range of the PLANT_TRUTH frame."""
    visits: Annotated[int, Interval(ge=1, le=10_000)] = 1
    """How many times the whole sequence of setpoints is played."""
    dwell_s: Annotated[float, Interval(gt=0.0, le=3600.0)]
    """How long each setpoint is held; a whole multiple of `setpoint_period_s`."""
    edges_s: tuple[Annotated[float, Interval(ge=0.0)], ...] = ()
    """Where setpoints move: the instants between which figures are computed; empty: each setpoint by itself."""
    table_from_s: Annotated[float, Interval(ge=0.0)] | None = None
    """When the law begins to use the stiction table; left out: from the start. It always learns from the start."""
    commission: bool = False
    """Whether the valve is identified first, on the same bus, and what it can reach is computed."""
    plant: dict[str, Any] = field(default_factory=dict)
    """The `[plant]` table, with the keys of a plant file: `preset` names a valve, the other keys change it."""
    valve: dict[str, Any] = field(default_factory=dict)
    """The valve as the daemon believes it to be, with the keys of its configuration; what is left out is that of the
    nominal valve of which the plant is a variant, with the preload, the lags and the backlash of the variant."""
    control: dict[str, Any] = field(default_factory=dict)
    """The law and its settings, with the keys of the configuration, but for `law` and `sample_period_s`."""
    estimator: dict[str, Any] = field(default_factory=dict)
    """Position and speed from readings, with the keys of the configuration; its noise: that of the nominal valve."""
    guard: dict[str, Any] = field(default_factory=dict)
    """Limits, ages of the data and arming, with the keys of the configuration; `auto_arm` is true if left out."""
    wire: dict[str, Any] = field(default_factory=dict)
    """Frames of the user's own, with the keys of the configuration: plant, host and daemon use them."""

    @property
    def visited_mm(self) -> tuple[float, ...]:
        """Every setpoint of the run in mm, one per dwell."""
        return self.setpoints_mm * self.visits

    @property
    def dwell_edges_s(self) -> tuple[float, ...]:
        """The instants in s at which dwells begin and, last, at which the run ends; shape (dwells + 1)."""
        return self.edges_s or tuple(index * self.dwell_s for index in range(len(self.visited_mm) + 1))

    @property
    def duration_s(self) -> float:
        """Length of the run in s, in the plant's time."""
        return len(self.visited_mm) * self.dwell_s

    @property
    def samples_per_dwell(self) -> int:
        """Control cycles in one dwell."""
        return round(self.dwell_s / self.sample_period_s)

    @property
    def samples_per_setpoint(self) -> int:
        """Control cycles from one setpoint frame to the next."""
        return round(self.setpoint_period_s / self.sample_period_s)

    def setpoint_m_at(self, sample: int) -> float:
        """Return the setpoint in m at `sample`; after the end the last one."""
        dwell = min(sample // self.samples_per_dwell, len(self.visited_mm) - 1)
        return self.visited_mm[dwell] * 1e-3


def scenario_names() -> tuple[str, ...]:
    """Return the names of the packaged scenarios, sorted."""
    files = resources.files(__package__).joinpath("scenarios").iterdir()
    return tuple(sorted(file.name.removesuffix(".toml") for file in files if file.name.endswith(".toml")))


def load_scenario(name_or_path: str) -> Scenario:
    """Return the packaged scenario of that name, or the one in that file: a path has a slash or ends in `.toml`.

    The file of a law, that of a plant's own physics, and a DBC lie beside that of the scenario, if they are relative.

    Raises:
        UsageError: no scenario has the name.
        ConfigurationError: the file cannot be read, or something in it is wrong.
    """
    if "/" in name_or_path or name_or_path.endswith(".toml"):
        path = Path(name_or_path)
        scenario = parse_scenario(toml_reader.read_text(path), name_or_path)
        wire = wire_table(path) if scenario.wire else {}
        law, plant = anchored(scenario.law, path.parent), dict(with_physics_in(scenario.plant, path.parent))
        return replace(scenario, law=law, plant=plant, wire=wire)
    check_name("scenario", name_or_path, scenario_names(), "or give the path of a .toml file")
    file = resources.files(__package__).joinpath("scenarios", f"{name_or_path}.toml")
    return parse_scenario(file.read_text(encoding="utf-8"), f"{name_or_path}.toml")


def parse_scenario(text: str, source: str) -> Scenario:
    """Return the scenario in the TOML `text`; `source` names it in the messages.

    Raises:
        ConfigurationError: a key is unknown, a value out of its limits, or the periods do not fit into each other.
    """
    scenario = toml_reader.parse(text, Scenario, source)
    _check_periods(scenario, source, text)
    return scenario


def check_scenario(scenario: Scenario, source: str) -> None:
    """Check a scenario that was not read from a file; the checks are those of `parse_scenario`.

    Raises:
        ConfigurationError: a value is out of its limits, or the periods do not fit into each other.
    """
    toml_reader.build(asdict(scenario), Scenario, source)
    _check_periods(scenario, source)


def _check_periods(scenario: Scenario, source: str, text: str = "") -> None:
    problems = tuple(
        problem_at(
            text,
            f"{longer} = {getattr(scenario, longer)}",
            f"must be a whole multiple of {shorter} = {getattr(scenario, shorter)}",
        )
        for longer, shorter in _MULTIPLES
        if not _is_multiple(getattr(scenario, longer), getattr(scenario, shorter))
    )
    if scenario.samples_per_setpoint > MOST_SAMPLES_PER_SETPOINT:
        where = f"setpoint_period_s = {scenario.setpoint_period_s}"
        most = f"must be at most {MOST_SAMPLES_PER_SETPOINT} sample periods: the sockets have no room for more frames"
        problems = (*problems, problem_at(text, where, most))
    for key in _OWN_KEYS:
        if key in scenario.control:
            own = f"the scenario itself has {key} = {getattr(scenario, key)}, for plant and positioner: leave it out"
            problems = (*problems, problem_at(text, f"control.{key} = {scenario.control[key]}", own))
    if problems:
        raise ConfigurationError(source, problems)


def _is_multiple(longer_s: float, shorter_s: float) -> bool:
    ratio = longer_s / shorter_s
    return math.isclose(ratio, round(ratio), rel_tol=_MULTIPLE_TOLERANCE)
