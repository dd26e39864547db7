"""The configuration of one positioner: its tables, their defaults, and the objects made from them. Shell."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from positioner.bus.address import BusAddress
from positioner.commissioning.step.limits import StepTestSettings
from positioner.commissioning.stroke.settings import StrokeSettings
from positioner.cycle.state import Setup
from positioner.errors import ConfigurationError, Problem
from positioner.guard.settings import GuardSettings
from positioner.health.counters import counter_settings
from positioner.health.monitor import HealthSettings
from positioner.health.move import MoveSettings
from positioner.health.pressure import PressureSettings
from positioner.health.reference import Reference
from positioner.health.settings import HealthTable
from positioner.health.watch import WatchSettings
from positioner.inputs.table import SettingsTable
from positioner.laws.estimator_settings import EstimatorSettings
from positioner.laws.registry import Ingredients, is_outside, make_law
from positioner.laws.settings import ControlSettings
from positioner.metrics.settings import MetricsSettings
from positioner.setpoint.settings import SetpointSettings
from positioner.valve.parameters import ValveParameters  # noqa: TC001 - pydantic reads this hint at run time
from positioner.wire.codec import Codec, make_codec
from positioner.wire.settings import WireSettings

if TYPE_CHECKING:
    from positioner.laws.law import Law
    from positioner.optimization.qp import Solver


@dataclass(frozen=True, slots=True, kw_only=True)
class StateSettings(SettingsTable):
    """The `[state]` table: where the stiction table is kept.

    directory: a relative one lies beside the file. Without one it is $STATE_DIRECTORY (which systemd sets), or else
        ~/.local/state/positioner/VALVE_ID.
    """

    directory: Path | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Configuration(SettingsTable):
    """All settings of a positioner; each field is one table of the file.

    valve: the valve, as the law believes it to be.
    bus: where the bus is.
    wire: frames of the user's own in place of ours.
    control: the law and its settings.
    estimator: position and speed from readings.
    guard: limits, ages of the data, arming, what FAILSAFE commands.
    setpoint: what becomes of the host's setpoint before a law pursues it; all off by default.
    health: trends against a reference, and alarms.
    metrics: where the metrics of this valve go.
    stroke_test: the partial stroke test.
    step_test: limits of the step test.
    state: where the stiction table and the health of the valve are kept.
    """

    valve: ValveParameters
    bus: BusAddress = field(default_factory=BusAddress)
    wire: WireSettings = field(default_factory=WireSettings)
    control: ControlSettings = field(default_factory=ControlSettings)
    estimator: EstimatorSettings = field(default_factory=EstimatorSettings)
    guard: GuardSettings = field(default_factory=GuardSettings)
    setpoint: SetpointSettings = field(default_factory=SetpointSettings)
    health: HealthTable = field(default_factory=HealthTable)
    stroke_test: StrokeSettings = field(default_factory=StrokeSettings)
    step_test: StepTestSettings = field(default_factory=StepTestSettings)
    metrics: MetricsSettings = field(default_factory=MetricsSettings)
    state: StateSettings = field(default_factory=StateSettings)

    @property
    def state_directory(self) -> Path:
        """Where the stiction table of this valve is kept."""
        if self.state.directory is not None:
            return self.state.directory / self.subfolder
        if given := os.environ.get("STATE_DIRECTORY"):
            return Path(given.split(":", maxsplit=1)[0]) / self.subfolder
        home = os.environ.get("XDG_STATE_HOME") or str(Path.home() / ".local" / "state")
        return Path(home) / "positioner" / self.valve.id

    @property
    def subfolder(self) -> Path:
        """Where the state of this valve is in the state directory of its file: there itself."""
        return Path()

    @property
    def retired(self) -> tuple[str, ...]:
        """A line where the file has settings of an older version, which have no effect."""
        keys = self.control.nmpc
        line = f"[control.nmpc] is of an older version and has no effect; leave it out: {', '.join(keys)}"
        return (line,) if keys else ()

    @property
    def health_settings(self) -> HealthSettings:
        """What the health of this valve is computed with, against the configured valve as reference."""
        own, period_s = self.estimator, self.control.sample_period_s
        moves = MoveSettings.of(self.valve, own.noise_of_reading, own.noise_of_span, period_s)
        pressure = PressureSettings.of(self.valve.pressure_gain_pa_per_ma, self.valve.actuator, period_s)
        watch = WatchSettings.of(moves, pressure, Reference.configured(self.valve), self.health)
        return HealthSettings(counter_settings(self.valve, own, period_s, self.health), watch)

    def make_codec(self) -> Codec:
        """Return the codec of this valve's bus.

        Raises:
            ConfigurationError: the user's DBC does not hold what the file names.
        """
        return make_codec(self.wire, span_m=self.valve.span_m)

    def make_setup(self, *, plays: bool = False, law: Law[Any] | None = None) -> Setup:
        """Return the constants of every cycle of this valve, with `law`, or else a new instance of its own.

        plays: as `make_law`.

        Raises:
            ConfigurationError: as `make_codec` and `make_law`.
        """
        codec = self.make_codec()
        setpoint = self.setpoint if self.setpoint.shapes else None
        period_s, law = self.control.sample_period_s, law or self.make_law(plays=plays)
        return Setup(codec, self.valve, self.guard, law, period_s, setpoint=setpoint)

    def make_law(self, *, plays: bool = False) -> Law[Any]:
        """Return a new instance of the chosen law, with a solver of its own.

        plays: the command plays a law or a plant, so the code of a plug-in may run. A command that only reads, as
            `check` or `explain`, never runs code that a configuration names.

        Raises:
            ConfigurationError: a law from outside cannot be loaded or made, or nobody said that it may be.
        """
        if not plays and is_outside(self.control.law):
            message = "is a plug-in, and this command runs no code that a configuration names; `positioner replay` does"
            raise ConfigurationError(self.control.law, (Problem("law", None, message),))
        return make_law(self.control.law, self.ingredients)

    def make_shadow(self) -> Law[Any] | None:
        """Return the law that runs beside the chosen one and sends nothing, None where there is none.

        Raises:
            ConfigurationError: a law from outside cannot be loaded or made.
        """
        return make_law(self.control.shadow, self.ingredients) if self.control.shadow else None

    @property
    def ingredients(self) -> Ingredients:
        """What a law is made of."""
        return Ingredients(self.control, self.valve, self.estimator, self.guard, _make_solver)


@dataclass(frozen=True, slots=True, kw_only=True)
class OneOfSeveral(Configuration):
    """All settings of one `[[valve]]`."""

    @property
    def subfolder(self) -> Path:
        """Where the state of this valve is in the state directory of its file: in a folder of its own."""
        return Path(self.valve.id)


def _make_solver(inputs: int, steps: int) -> Solver:
    from positioner.optimization.solver import QpSolver  # noqa: PLC0415 - OSQP takes long to load, few commands solve

    return QpSolver(inputs, steps)
