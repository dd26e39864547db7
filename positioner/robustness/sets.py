"""Named sets of the robustness test: one thing about the nominal valve is different in each case. Pure.

`conditions` has single mismatches at 1 kHz, each at three configured lags; the others sweep one kind of difference.
Every case has setpoints of its own at random, so that no round number decides. The nominal valve is the paper's, with
0.5 % noise of the reading, between that of a good sensor and the paper's 2 %.
"""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from plant_emulator.presets import plant_settings, preset_names, root_preset
from positioner.bench.playable import restartable_mm
from positioner.inputs.toml_reader import laid_over
from positioner.robustness.cases import ROOT, Case, walk

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from positioner.robustness.space import Space

Tables = dict[str, Any]

_NOISE = 0.005
_LAGS_S = (0.0, 0.01, 0.1)
_KEPT_MM = 6.0
"""Of the reach at either end no setpoint is drawn: a process force of 300 N moves it by that much. In a shorter valve
it is as much of the span."""
_NOMINAL = plant_settings(ROOT)
_GAIN = _NOMINAL.valve.pressure_gain_pa_per_ma


def _actuator(**values: float) -> Tables:
    return {"actuator": values}


def _lag(lag_s: float) -> Tables:
    return _actuator(fill_time_constant_s=lag_s, vent_time_constant_s=lag_s)


def _valve(**factors: float) -> Tables:
    """Return parameters of the valve as multiples of the nominal ones."""
    return {"valve": {name: factor * getattr(_NOMINAL.valve, name) for name, factor in factors.items()}}


def _sensor(**values: float) -> Tables:
    return {"sensor": values}


def _friction(static: float, coulomb: float) -> Tables:
    return _valve(static_friction_n=static, coulomb_friction_n=coulomb)


def _process(**values: float) -> Tables:
    return {"process": values}


def _packing(**values: float) -> Tables:
    return {"packing": values}


Change = tuple[str, Tables, Tables]
"""A name, what is different in the true valve, and in the one that the positioner is told."""

_MISMATCHES: tuple[Change, ...] = (
    ("as configured", {}, {}),
    ("spring × 0.8", _valve(spring_rate_n_per_m=0.8), {}),
    ("spring × 1.2", _valve(spring_rate_n_per_m=1.2), {}),
    ("friction × 0.1", _friction(0.1, 0.1), {}),
    ("friction × 0.75", _friction(0.75, 0.75), {}),
    ("friction × 1.25", _friction(1.25, 1.25), {}),
    ("F_s × 1.25, F_c × 0.75", _friction(1.25, 0.75), {}),
    ("lag + 5 ms", {}, {}),
    ("dead time 5 ms", _actuator(dead_time_s=0.005), {}),
    ("I/P lag 10 ms", _actuator(converter_time_constant_s=0.01), {}),
    ("sensor lag 5 ms", _sensor(time_constant_s=0.005), {}),
    ("slew limit 40 mA/s", _actuator(slew_pa_per_s=40.0 * _GAIN), {}),
    ("backlash 0.3 %", _sensor(backlash_m=0.003 * _NOMINAL.valve.span_m), {}),
    ("supply 17 mA", _actuator(supply_pa=17.0 * _GAIN), {}),
    ("hysteresis 0.1 mA", _actuator(hysteresis_ma=0.1), {}),
    ("friction by place ± 15 %", _packing(place_fraction=0.15), {}),
    ("friction by direction ± 15 %", _packing(direction_fraction=0.15), {}),
    ("friction scatter ± 15 %", {"stochastic": {"friction_fraction": 0.15}}, {}),
    ("friction grows 10 % a decade", _packing(growth_per_decade=0.1), {}),
    ("correlated noise, 20 ms", _sensor(noise_correlation_s=0.02), {}),
    ("noise × 2", _sensor(noise_of_reading=2.0 * _NOISE), {}),
    ("force noise 60 N", _process(noise_n=60.0), {}),
)


def _conditions(space: Space, count: int) -> Iterator[Case]:
    for name, true, told in _MISMATCHES:
        for lag_s in _LAGS_S:
            true_lag_s = lag_s + 0.005 if name == "lag + 5 ms" else lag_s
            yield from _cases(
                space,
                "conditions",
                f"{name}, lag {lag_s * 1e3:g} ms",
                laid_over(_lag(true_lag_s), true),
                laid_over(_lag(lag_s), told),
                count,
            )


def _periods(space: Space, count: int) -> Iterator[Case]:
    for period_s in (0.001, 0.002, 0.005, 0.01, 0.02):
        for lag_s in _LAGS_S:
            for noise in (0.0005, 0.02):
                both = laid_over(_lag(lag_s), _sensor(noise_of_reading=noise))
                name = f"{period_s * 1e3:g} ms, lag {lag_s * 1e3:g} ms, noise {noise * 100.0:g} %"
                yield from _cases(space, "periods", name, both, both, count, period_s=period_s)


def _lags(space: Space, count: int) -> Iterator[Case]:
    for lag_s in (0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.3):
        for name, told_s in (("not configured", 0.0), ("configured × 0.5", 0.5), ("configured × 2", 2.0)):
            text = f"{lag_s * 1e3:g} ms, {name}"
            yield from _cases(space, "lags", text, _lag(lag_s), _lag(told_s * lag_s), count)
    for lag_s in (0.001, 0.005, 0.02, 0.1):
        yield from _cases(space, "lags", f"{lag_s * 1e3:g} ms, configured and absent", {}, _lag(lag_s), count)


def _forces(space: Space, count: int) -> Iterator[Case]:
    for lag_s in _LAGS_S:
        told, end = _lag(lag_s), f", lag {lag_s * 1e3:g} ms"
        for force_n in (-600.0, -300.0, 300.0, 600.0):
            true = laid_over(told, _process(force_n=force_n))
            yield from _cases(space, "forces", f"constant {force_n:g} N{end}", true, told, count)
        for step_n in (150.0, 300.0, 600.0):
            yield from _cases(space, "forces", f"steps ± {step_n:g} N{end}", told, told, count, force_step_n=step_n)
        for sine_n, hertz in ((100.0, 0.2), (300.0, 0.05), (300.0, 0.2), (300.0, 1.0)):
            true = laid_over(told, _process(sine_n=sine_n, sine_hz=hertz))
            yield from _cases(space, "forces", f"sine {sine_n:g} N at {hertz:g} Hz{end}", true, told, count)
        for noise_n in (20.0, 60.0, 200.0):
            true = laid_over(told, _process(noise_n=noise_n))
            yield from _cases(space, "forces", f"noise {noise_n:g} N{end}", true, told, count)


def _rates(space: Space, count: int) -> Iterator[Case]:
    for lag_s in (0.005, 0.02, 0.05, 0.1):
        for rate in (1000.0, 300.0, 100.0):
            text = f"{rate:g} mA/s, lag {lag_s * 1e3:g} ms"
            guard = {"max_rate_ma_per_s": rate}
            yield from _cases(space, "rates", text, _lag(lag_s), _lag(lag_s), count, guard=guard)


def _wear(space: Space, count: int) -> Iterator[Case]:
    moves = 500
    for lag_s in (0.0, 0.02):
        for change in (-0.3, 0.3):
            true = laid_over(_lag(lag_s), _packing(drift_per_move=change / moves))
            name = f"friction {change * 100.0:+g} % over {moves} moves, lag {lag_s * 1e3:g} ms"
            yield from _cases(space, "wear", name, true, _lag(lag_s), max(count // 4, 1), dwells=moves)


def _restart(space: Space, count: int) -> Iterator[Case]:
    changes = (
        ("friction × 0.75", _friction(0.75, 0.75)),
        ("friction × 1.25", _friction(1.25, 1.25)),
        ("F_s × 1.25, F_c × 0.75", _friction(1.25, 0.75)),
        ("spring × 0.8", _valve(spring_rate_n_per_m=0.8)),
        ("spring × 1.2", _valve(spring_rate_n_per_m=1.2)),
    )
    for lag_s in (0.0, 0.05):
        for name, change in changes:
            for again in (False, True):
                text = f"{name}, lag {lag_s * 1e3:g} ms, {'restarted with its table' if again else 'first start'}"
                true = laid_over(_lag(lag_s), change)
                yield from _cases(space, "restart", text, true, _lag(lag_s), count, restart=again, dwells=3)


OTHER_PHYSICS = tuple(
    name
    for name in preset_names()
    if (plant_settings(name).friction.model, plant_settings(name).actuator.model) != ("karnopp", "lag")
)
"""The presets that do not move as the nominal valve does, whose model the laws have."""


def _physics(space: Space, count: int) -> Iterator[Case]:
    """Yield each preset of other physics, told its nominal valve; where that has no lag, also behind known ones."""
    for name in OTHER_PHYSICS:
        root, plain = root_preset(name), plant_settings(name)
        has_lag = plain.actuator.model == "lag" and root == ROOT
        for lag_s in _LAGS_S if has_lag else (0.0,):
            lag = _lag(lag_s) if has_lag else {}
            noise = _sensor(noise_of_reading=_NOISE) if root == ROOT else {}
            true = laid_over({"preset": name, **noise}, lag)
            told = laid_over({"preset": root, **noise}, lag)
            text = f"{name}, lag {lag_s * 1e3:g} ms" if has_lag else name
            yield from _cases(space, "physics", text, true, told, count)


SETS: Mapping[str, Callable[[Space, int], Iterator[Case]]] = MappingProxyType(
    {
        "conditions": _conditions,
        "periods": _periods,
        "lags": _lags,
        "forces": _forces,
        "rates": _rates,
        "wear": _wear,
        "restart": _restart,
        "physics": _physics,
    }
)
"""By name: the function that yields the cases of a set, so many of each kind."""


def _cases(
    space: Space,
    group: str,
    name: str,
    true: Tables,
    told: Tables,
    count: int,
    *,
    period_s: float = 0.001,
    dwells: int | None = None,
    force_step_n: float = 0.0,
    restart: bool = False,
    guard: Tables | None = None,
) -> Iterator[Case]:
    """Yield `count` cases that differ in setpoints and noise; cases of equal number have equal setpoints."""
    base: Tables = {"preset": ROOT, "sensor": {"noise_of_reading": _NOISE}}
    if "preset" not in true:
        true, told = laid_over(base, true), laid_over(base, told)
    settings = plant_settings(overrides=true)
    low_mm, high_mm = restartable_mm(settings)
    span_m = settings.valve.span_m
    kept_mm = _KEPT_MM * span_m / _NOMINAL.valve.span_m
    for number in range(count):
        chance = np.random.default_rng((number, 20))
        begin_mm, setpoints_mm = walk(
            space, chance, low_mm + kept_mm, high_mm - kept_mm, dwells or space.dwells, span_m
        )
        start = {"valve": {"initial_position_m": begin_mm * 1e-3}}
        yield Case(
            group=group,
            name=f"{name} #{number}",
            seed=1000 + number,
            period_s=period_s,
            setpoints_mm=setpoints_mm,
            true=laid_over(true, start),
            told=told,
            least_s=2.0 * space.dwell.least_s,
            force_step_n=force_step_n,
            restart=restart,
            guard=guard or {},
        )
