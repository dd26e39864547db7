"""`simulate`: a closed loop of law and plant in this process, as arrays and figures. Shell: reads files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

from plant_emulator.presets import overridden
from positioner.bench import metrics
from positioner.bench.inprocess import configure, run_in_process
from positioner.bench.modes import mode_spans
from positioner.bench.own_plant import on_own_plant, with_plant
from positioner.bench.playable import check_playable
from positioner.bench.scenario import Scenario, check_scenario
from positioner.bench.sensor_noise import with_noise
from positioner.bench.setpoints import with_setpoints
from positioner.cycle.events import LawFellBack
from positioner.errors import UsageError
from positioner.inputs.nearest import nearest
from positioner.laws.registry import outside_law

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import numpy as np
    from numpy.typing import NDArray

    from positioner.bench.metrics import DwellMetrics, Totals
    from positioner.bench.modes import ModeSpan
    from positioner.laws.law import Law
    from positioner.laws.registry import Ingredients
    from positioner.valve.stiction import StictionTable

Tables: TypeAlias = Mapping[str, Any]
"""Tables of a file, by name."""

_NAME = "simulation"
_ARGUMENTS = {"law": "law", "sample_period_s": "period_s"}
"""Keys of `[control]` that are arguments of `simulate`."""
_TABLES = ("valve", "control", "estimator", "guard")


@dataclass(frozen=True, slots=True, kw_only=True)
class Simulation:
    """A run: arrays with one value for each sample, shape (n,), and the figures of a bench.

    Attributes:
        time_s: the instant of each reading.
        position_m: the true position of the stem.
        measured_m: the readings.
        setpoint_m: what was asked for.
        current_ma: the command that answers the reading.
        speed_m_per_s: the true speed of the stem.
        modes: the modes of the guard from beginning to end.
        dwells: figures of each setpoint.
        totals: figures of all setpoints together.
        failures: each error that the law raised, once, in the order of their first time.
        table: the stiction table at the end; another run may start from it.
        span_m: the travel that is 100 %.
    """

    time_s: NDArray[np.float64]
    position_m: NDArray[np.float64]
    measured_m: NDArray[np.float64]
    setpoint_m: NDArray[np.float64]
    current_ma: NDArray[np.float64]
    speed_m_per_s: NDArray[np.float64]
    modes: tuple[ModeSpan, ...]
    dwells: tuple[DwellMetrics, ...]
    totals: Totals
    failures: tuple[str, ...]
    table: StictionTable
    span_m: float


def simulate(
    plant: str | Tables = "paper",
    law: str | Callable[[Ingredients], Any] = "nmpc",
    setpoints: str | Sequence[float] = (73.0, 87.0, 80.0),
    *,
    dwell_s: float = 1.2,
    seed: int = 1,
    period_s: float = 0.001,
    noise: str | None = None,
    configuration: Tables | None = None,
    table: StictionTable | None = None,
) -> Simulation:
    """Return the run of `law` on `plant`.

    Args:
        plant: the name of a preset, FILE.toml, FILE.py:NAME, or the tables of a plant file.
        law: a name, FILE.py:NAME, or a class (or function) that makes a law of its `Ingredients`.
        setpoints: in mm, each for a dwell; or text as `positioner bench --setpoints` takes it, such as "ramp:10".
        dwell_s: how long each setpoint is held, in s; a multiple of ten periods.
        seed: of noise and friction; the same one gives the same run.
        period_s: sample period in s.
        noise: of the position sensor, as `positioner bench --noise` takes it, such as "gaussian:0.05%".
        configuration: tables of the positioner's configuration that differ from what the plant implies: `valve`,
            `control` (without `law` and `sample_period_s`, which are arguments), `estimator`, `guard`.
        table: the stiction table to start from; None for an empty one.

    Raises:
        PositionerError: there is no such law or plant, a value is out of its limits, or the plant cannot be restarted
            from a setpoint; the message has a line for each mistake.
    """
    scenario = _scenario(plant, law, setpoints, dwell_s, seed, period_s, noise, configuration or {})
    settings = configure(scenario)
    valve = check_playable(scenario, settings)
    made: Law[Any] | None = None
    if not isinstance(law, str):
        made = outside_law(getattr(law, "__name__", "law"), law, settings.ingredients)
    run = run_in_process(scenario, table, law=made)
    recording = run.recording
    recording.read_modes()
    silent_s = max(valve.deadman_s, 3.0 * period_s)
    dwells = metrics.dwell_metrics(recording.trace, scenario.dwell_edges_s, settings.valve.span_m)
    fell_back = (event.why for event in run.events if isinstance(event, LawFellBack) and " failed: " in event.why)
    return Simulation(
        time_s=recording.time_s,
        position_m=recording.true_position_m,
        measured_m=recording.measured_m,
        setpoint_m=recording.setpoint_m,
        current_ma=recording.current_ma,
        speed_m_per_s=recording.true_velocity_m_per_s,
        modes=mode_spans(recording.mode_reports, scenario.duration_s, silent_s),
        dwells=dwells,
        totals=metrics.totals(dwells),
        failures=tuple(dict.fromkeys(fell_back)),
        table=run.table,
        span_m=settings.valve.span_m,
    )


def _scenario(
    plant: str | Tables,
    law: str | Callable[[Ingredients], Any],
    setpoints: str | Sequence[float],
    dwell_s: float,
    seed: int,
    period_s: float,
    noise: str | None,
    tables: Tables,
) -> Scenario:
    if unknown := [name for name in tables if name not in _TABLES]:
        raise UsageError(f"configuration: {unknown[0]!r} is unknown; {nearest(unknown[0], _TABLES)}")
    for key, argument in _ARGUMENTS.items():
        if key in tables.get("control", {}):
            raise UsageError(
                f"configuration: control.{key} contradicts {argument}=…, which plant and law share: give that"
            )
    valve, control, estimator, guard = (dict(tables.get(name, {})) for name in _TABLES)
    scenario = Scenario(
        name=_NAME,
        title=_NAME,
        law=law if isinstance(law, str) else "pi",  # any name: its place is taken by the object
        seed=seed,
        sample_period_s=period_s,
        setpoint_period_s=10.0 * period_s,
        setpoints_mm=(80.0,) if isinstance(setpoints, str) else _in_mm(setpoints),
        dwell_s=dwell_s,
        valve=valve,
        control=control,
        estimator=estimator,
        guard=guard,
    )
    if isinstance(plant, str):
        scenario = with_plant(scenario, plant)
    else:
        scenario = on_own_plant(scenario, overridden(plant, {}, "plant"))
    if noise is not None:
        scenario = with_noise(scenario, noise)
    if isinstance(setpoints, str):
        scenario = with_setpoints(scenario, setpoints)
    check_scenario(scenario, _NAME)
    return scenario


def _in_mm(setpoints: Sequence[float]) -> tuple[float, ...]:
    try:
        return tuple(float(each) for each in setpoints)
    except (TypeError, ValueError) as error:
        example = '(73.0, 87.0), or text such as "ramp:10"'
        raise UsageError(f"setpoints = {setpoints!r}: give numbers in mm, such as {example}") from error
