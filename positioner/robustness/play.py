"""One case with one law: figures of every dwell. A function of the case alone. Pure.

The length of a dwell follows from the time-optimal move on the true valve, so it is computed where the case is played.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass, replace
from hashlib import sha256
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from plant_emulator.mass_flow import ATMOSPHERE_PA, REFERENCE_PA
from plant_emulator.parameters import ActuatorModel
from plant_emulator.presets import plant_settings, root_preset
from positioner.bench import metrics
from positioner.bench.configure import told
from positioner.bench.inprocess import run_in_process
from positioner.bench.scenario import Scenario
from positioner.studies.limit import optimal_move
from positioner.studies.real_valves.tuned import rival_tables
from positioner.wire.messages import Cause, Mode

if TYPE_CHECKING:
    from collections.abc import Sequence

    from plant_emulator.parameters import PlantSettings
    from positioner.bench.inprocess import InProcessRun
    from positioner.robustness.cases import Case

OPTIMAL = "time-optimal"
"""Not a law: the shortest time of every move, by the true valve."""
HUNTING_BAND = 0.01
"""Of the span: a reversal of the stem counts as hunting when the motion back is larger."""

_SETPOINT_PERIODS = 10
_STEADY_S, _STEADY_MOVES = 1.0, 5.0
"""At the end of a dwell no force steps for so long: seconds, and time-optimal moves."""
_SIGNAL_MA = 16.0
_LOW_NOISE = 0.003
"""σ of the reading below which the baselines have the parameters that were tuned for 0.05 % noise, else for 2 %: the
geometric mean of 0.0005 and 0.02."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Dwell:
    """The figures of one dwell; percentages are of the span.

    error_pct, worst_pct: mean and largest |error| over the last 0.5 s (or the second half, if that is shorter).
    settle_s: from the new setpoint until the error stays within 1 %; None: never. overshoot_pct: past the setpoint.
    moves: how often the law began one. travel_mm, ideal_mm: path of the stem, and its shortest one.
    hunts: three or more reversals of more than 1 % in the last half. good: the last status was ACTIVE, without a cause.
    told_s: from the new setpoint until the status had a cause; None: it had none.
    """

    setpoint_mm: float
    step_mm: float
    error_pct: float
    worst_pct: float
    settle_s: float | None
    overshoot_pct: float
    moves: int
    travel_mm: float
    ideal_mm: float
    hunts: bool
    good: bool
    told_s: float | None
    end_mm: float


@dataclass(frozen=True, slots=True)
class Played:
    """The dwells of a case; or what ended it before its time, which happens in the same way each time."""

    dwells: tuple[Dwell, ...]
    optimal_s: tuple[float, ...] = ()
    """Of the time-optimal moves alone: the settling of each dwell."""
    failure: str | None = None


@dataclass(frozen=True, slots=True)
class Run:
    """A case and who plays it; informed: the positioner is told the true parameters."""

    case: Case
    law: str
    informed: bool = False

    @property
    def physics(self) -> str:
        """The name of the plant's own physics, empty where it has those of the emulator."""
        return str(self.case.true.get("physics", ""))

    @property
    def label(self) -> str:
        """What the progress bar shows."""
        return f"{self.law}: {self.case.label}"

    @property
    def key(self) -> str:
        """A digest of all that the figures depend on, except the code."""
        content = {**asdict(self.case), "law": self.law, "informed": self.informed}
        for name in ("group", "name", "factors"):
            del content[name]
        return sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def settings_of(case: Case) -> PlantSettings:
    """Return the emulated valve of a case, without the steps of its force."""
    return plant_settings(overrides=case.true)


def scenario_of(run: Run) -> Scenario:
    """Return the run as a scenario of the bench, with the whole dwells that its time-optimal moves ask for.

    Raises:
        ConfigurationError: its tables do not make a valve.
    """
    case, settings = run.case, settings_of(run.case)
    believed = plant_settings(overrides=case.true if run.informed else case.told)
    period_s = case.period_s
    setpoint_s = round(_SETPOINT_PERIODS * period_s, 9)
    dwell_s = case.dwell_s
    longest_s = _longest_move_s(case, settings)
    if dwell_s is None:
        dwell_s = max(case.optimal_moves * longest_s, case.least_s)
        if case.force_step_n:
            dwell_s = max(dwell_s, 2.0 * _steady_s(longest_s))
    count = math.ceil(dwell_s / setpoint_s - 1e-9)
    true = dict(case.true)
    if case.force_step_n:
        true["schedule"] = _force_steps(case, count * setpoint_s, _steady_s(longest_s))
    noise = believed.sensor.noise_of_reading
    lag_s = believed.actuator.fill_time_constant_s
    control = dict(case.control) if run.law.startswith("nmpc") else _tuned(run.law, lag_s, noise)
    valve = told(believed)
    return Scenario(
        name="robustness",
        title=case.label[:80],
        law=run.law,
        seed=case.seed,
        sample_period_s=period_s,
        setpoint_period_s=setpoint_s,
        setpoints_mm=case.setpoints_mm,
        dwell_s=round(count * setpoint_s, 9),
        plant=true,
        valve={"preset": root_preset(case.true["preset"]), **valve},
        control=control,
        guard=dict(case.guard),
        estimator={"noise_of_reading": noise, "noise_of_span": believed.sensor.noise_of_span},
    )


def play(run: Run) -> Played:
    """Return the figures of a run."""
    try:
        if run.law == OPTIMAL:
            return Played((), _optimal_s(run.case))
        scenario = scenario_of(run)
        return Played(_dwells(scenario, recorded(run, scenario)))
    except (MemoryError, OSError):
        raise  # the machine, not the run
    except Exception as error:  # noqa: BLE001 - one run at the end of a range must not end the study
        return Played((), failure=f"{type(error).__name__}: {error}")


def before(scenario: Scenario) -> Scenario:
    """Return what fills the stiction table of a scenario that is restarted: the same with other noise."""
    return replace(scenario, seed=(scenario.seed + 1) % (1 << 31))


def recorded(run: Run, scenario: Scenario) -> InProcessRun:
    """Return what happens in the run, whose scenario is `scenario`."""
    table = run_in_process(before(scenario), beyond_reach=True).table if run.case.restart else None
    return run_in_process(scenario, table, beyond_reach=True)


def _dwells(scenario: Scenario, played: InProcessRun) -> tuple[Dwell, ...]:
    recording, span_m = played.recording, plant_settings(overrides=scenario.plant).valve.span_m
    figures = metrics.dwell_metrics(recording.trace, scenario.dwell_edges_s, span_m)
    begins_s = [event.time_s for event in played.cycles if event.decision.reason is not None]
    found, per_dwell = [], scenario.samples_per_dwell
    for number, each in enumerate(figures):
        begin_s, end_s = scenario.dwell_edges_s[number : number + 2]
        path_m = recording.true_position_m[number * per_dwell : (number + 1) * per_dwell]
        reports = [one for one in recording.mode_reports if one.cause is not None and begin_s <= one.time_s < end_s]
        told_s = next((one.time_s - begin_s for one in reports if one.cause is not Cause.NONE), None)
        good = bool(reports) and reports[-1].mode is Mode.ACTIVE and reports[-1].cause is Cause.NONE
        start_m = recording.true_position_m[max(number * per_dwell - 1, 0)]
        found.append(
            Dwell(
                setpoint_mm=each.setpoint_mm,
                step_mm=each.setpoint_mm - float(start_m) * 1e3,
                error_pct=each.mean_abs_error_pct,
                worst_pct=each.max_abs_error_pct,
                settle_s=each.settle_1pct_s,
                overshoot_pct=each.overshoot_pct,
                moves=sum(begin_s <= one < end_s for one in begins_s),
                travel_mm=each.travel_mm,
                ideal_mm=each.ideal_travel_mm,
                hunts=metrics.count_reversals(path_m[per_dwell // 2 :], HUNTING_BAND * span_m) >= 3,  # noqa: PLR2004
                good=good,
                told_s=told_s,
                end_mm=float(path_m[-1]) * 1e3,
            )
        )
    return tuple(found)


def _tuned(law: str, lag_s: float, noise: float) -> dict[str, Any]:
    """Return the `[control]` table of a baseline: tuned for the lag that is nearest to the configured one."""
    return rival_tables(law, lag_s, "0.05" if noise < _LOW_NOISE else "2") if lag_s else {}


def _steady_s(longest_s: float) -> float:
    return max(_STEADY_S, _STEADY_MOVES * longest_s)


def _force_steps(case: Case, dwell_s: float, steady_s: float) -> list[dict[str, Any]]:
    """Return the schedule of a process force that steps once in each dwell, between two values."""
    chance = np.random.default_rng(case.seed)
    force_n = case.true.get("process", {}).get("force_n", 0.0)
    return [
        {
            "at_s": round(number * dwell_s + float(chance.random()) * (dwell_s - steady_s), 6),
            "key": "process.force_n",
            "value": force_n + (case.force_step_n if number % 2 == 0 else -case.force_step_n),
        }
        for number in range(len(case.setpoints_mm))
    ]


def _pauses_s(settings: PlantSettings) -> float:
    """Return about how long the pressure takes, to choose a resolution in time."""
    actuator, chamber = settings.actuator, settings.chamber
    if actuator.model is ActuatorModel.MASS_FLOW:  # the choked filling of the whole chamber by the whole signal
        volume_m3 = chamber.dead_volume_m3 + settings.valve.diaphragm_area_m2 * settings.valve.span_m
        pressure_pa = _SIGNAL_MA * settings.valve.pressure_gain_pa_per_ma
        flow = chamber.fill_conductance_m3_per_s_pa * REFERENCE_PA * (actuator.supply_pa + ATMOSPHERE_PA)
        return volume_m3 * pressure_pa / flow
    slew_s = 0.0
    if actuator.slew_pa_per_s:
        slew_s = 8.0 * settings.valve.pressure_gain_pa_per_ma / actuator.slew_pa_per_s
    lags_s = actuator.fill_time_constant_s + actuator.vent_time_constant_s + actuator.converter_time_constant_s
    return 0.02 + 2.0 * lags_s + actuator.dead_time_s + slew_s


def _optimal_move_s(case: Case, settings: PlantSettings, start_mm: float, end_mm: float) -> float:
    """Return the settling time to 1 % of the time-optimal move, at least one sample period; a case has no force."""
    about_s = _pauses_s(settings)
    move = optimal_move(
        settings, start_mm * 1e-3, end_mm * 1e-3, step_s=about_s / 100.0, longest_s=20.0 * about_s, bisections=14
    )
    return max(move.rest_s, case.period_s)


def _quiet(settings: PlantSettings) -> PlantSettings:
    """Return the valve without what an optimal move need not know: forces that change, friction that ages."""
    process = replace(settings.process, noise_n=0.0, sine_n=0.0)
    plain = replace(settings.packing, growth_per_decade=0.0, drift_per_move=0.0)
    return replace(settings, process=process, packing=plain)


def _longest_move_s(case: Case, settings: PlantSettings) -> float:
    places_mm = (settings.valve.initial_position_m * 1e3, *case.setpoints_mm)
    start_mm, end_mm = max(pairwise(places_mm), key=lambda pair: abs(pair[1] - pair[0]))
    return _optimal_move_s(case, _quiet(settings), start_mm, end_mm)


def _optimal_s(case: Case) -> tuple[float, ...]:
    settings = settings_of(case)
    quiet = _quiet(settings)
    places_mm: Sequence[float] = (settings.valve.initial_position_m * 1e3, *case.setpoints_mm)
    return tuple(
        _optimal_move_s(case, quiet, start_mm, end_mm) if start_mm != end_mm else case.period_s
        for start_mm, end_mm in pairwise(places_mm)
    )
