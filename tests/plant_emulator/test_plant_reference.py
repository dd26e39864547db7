"""The emulator against an independent integration of Karnopp's valve: SciPy, with its own event location."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from plant_emulator import valve
from plant_emulator.presets import plant_settings

if TYPE_CHECKING:
    from plant_emulator.parameters import PlantSettings

Vector = np.ndarray[Any, np.dtype[np.float64]]


@dataclass
class Reference:
    """Karnopp's valve, written down a second time: pressures and reading are integrated along with the motion."""

    settings: PlantSettings
    x: float
    force: float
    converter: float
    shown: float
    v: float = 0.0
    slipped: bool = False

    def step(self, target: float, duration: float) -> None:
        act = self.settings.actuator
        tau = act.fill_time_constant_s if target > self.force else act.vent_time_constant_s
        if act.converter_time_constant_s == 0.0:
            self.converter = target
        if tau == 0.0:
            self.force = target
        left = duration
        while left > 1e-13:
            left -= self._phase(target, left)

    def _phase(self, target: float, left: float) -> float:
        """Integrate up to the next change of regime, and return how long that took."""
        v = self.settings.valve
        band, stribeck = v.stick_velocity_m_per_s, v.stribeck_velocity_m_per_s
        mode, way = self._mode()
        # an adaptive step would leap over the whole of Stribeck's curve, so it stops before, and goes on in small ones
        has_kinks = self.settings.actuator.slew_pa_per_s or self.settings.actuator.converter_time_constant_s
        sensor_s = self.settings.sensor.time_constant_s or 1.0
        curved = max(10.0 * stribeck, 2.0 * band)
        slow = mode == "slide" and abs(self.v) <= curved * (1 + 1e-9)
        level = curved if mode == "slide" and not slow else band

        def rates(_t: float, y: Vector) -> list[float]:
            x, speed, force, converter, shown = y
            dry = v.static_friction_n
            if mode == "slide":
                bend = math.exp(-((speed / stribeck) ** 2))
                dry = v.coulomb_friction_n + (v.static_friction_n - v.coulomb_friction_n) * bend
                dry += v.viscous_friction_n_s_per_m * abs(speed)
            net = 0.0 if mode == "rest" else force - v.spring_rate_n_per_m * x - way * dry
            return [speed, net / v.mass_kg, *self._pressures(force, converter, target), (x - shown) / sensor_s]

        def slips(_t: float, y: Vector) -> float:
            return float(abs(y[2] - v.spring_rate_n_per_m * y[0]) - v.static_friction_n)

        def passes(_t: float, y: Vector) -> float:
            return float(way * y[1] - level)

        def hurries(_t: float, y: Vector) -> float:
            return float(way * y[1] - 1.2 * curved)

        events: list[Any] = [slips] if mode == "rest" else [passes, hurries] if slow else [passes]
        for event in events:
            event.terminal = True
            event.direction = -1.0 if event is passes and mode == "slide" else 1.0
        run = solve_ivp(
            rates,
            (0.0, left),
            [self.x, self.v, self.force, self.converter, self.shown],
            method="DOP853",
            events=events,
            rtol=1e-12,
            atol=[1e-15, 1e-14, 1e-10, 1e-10, 1e-14],
            max_step=2e-5 if slow else 5e-4 if has_kinks else np.inf,
        )
        self.x, self.v, self.force, self.converter, self.shown = (float(value) for value in run.y[:, -1])
        if run.status == 1 and len(run.t_events[0]):
            self.slipped = mode == "rest"
            self.v = 0.0 if self.slipped else way * level
        return float(run.t[-1])

    def _pressures(self, force: float, converter: float, target: float) -> tuple[float, float]:
        """Return the rates of the force and of the converter's pressure (as a force)."""
        act, v = self.settings.actuator, self.settings.valve
        lag, tau = act.converter_time_constant_s, act.fill_time_constant_s
        if converter < force:
            tau = act.vent_time_constant_s
        rate = (converter - force) / tau if tau else 0.0
        if act.slew_pa_per_s:
            highest = act.slew_pa_per_s * v.diaphragm_area_m2
            rate = min(max(rate, -highest), highest)
        return rate, (target - converter) / lag if lag else 0.0

    def _mode(self) -> tuple[str, int]:
        """Return the regime of eq. 3, and the sign of its friction; at rest, stop."""
        v = self.settings.valve
        pull = self.force - v.spring_rate_n_per_m * self.x
        in_band = abs(self.v) <= v.stick_velocity_m_per_s * (1 + 1e-9)
        if self.slipped:
            self.slipped = False
            return "band", int(math.copysign(1, pull))
        if in_band and abs(pull) <= v.static_friction_n * (1 + 1e-12):
            self.v = 0.0
            return "rest", 0
        if abs(self.v) < v.stick_velocity_m_per_s * (1 - 1e-9) or (in_band and self.v * pull < 0.0):
            return "band", int(math.copysign(1, pull))
        return "slide", int(math.copysign(1, self.v))


LAGS = "actuator.fill_time_constant_s = 0.004\nactuator.vent_time_constant_s = 0.009\n"


@pytest.mark.parametrize(
    "overrides",
    [
        "",
        LAGS,
        "sensor.time_constant_s = 0.005",
        LAGS + "sensor.time_constant_s = 0.02",
        LAGS + "actuator.converter_time_constant_s = 0.005\nsensor.time_constant_s = 0.002",
        LAGS + "actuator.slew_pa_per_s = 1e6",
        LAGS
        + "actuator.converter_time_constant_s = 0.008\nactuator.slew_pa_per_s = 7e5\nsensor.time_constant_s = 0.001",
        "sensor.time_constant_s = 0.004\nvalve.stribeck_velocity_m_per_s = 0.01",
        "valve.viscous_friction_n_s_per_m = 300.0",  # complex poles
        "valve.stribeck_velocity_m_per_s = 0.01",  # a curve that bends the whole motion
        "valve.stick_velocity_m_per_s = 0.002",  # a band wider than the curve
    ],
)
def test_the_emulator_agrees_with_an_independent_integration(overrides: str) -> None:
    settings = plant_settings("paper", overrides)
    v = settings.valve
    gain = v.diaphragm_area_m2 * v.pressure_gain_pa_per_ma
    state = valve.initial_state(settings, 0)
    start_m = state.stem.position_m
    start_n = v.spring_rate_n_per_m * start_m
    reference = Reference(settings, start_m, start_n, start_n, start_m)
    quiet = plant_settings("noise-free")
    moved = 0
    for current, duration in ((6.9, 0.08), (9.0, 0.004), (3.0, 0.006), (12.0, 0.01), (7.5, 0.05), (14.0, 0.1)):
        state = valve.step(settings, state, current, duration)
        reference.step(gain * current, duration)
        assert state.stem.position_m == pytest.approx(reference.x, abs=1e-9)
        assert state.stem.velocity_m_per_s == pytest.approx(reference.v, abs=1e-6)
        assert state.actuator.pressure_pa * v.diaphragm_area_m2 == pytest.approx(reference.force, rel=1e-9)
        if settings.sensor.time_constant_s:
            assert valve.measure(quiet, state)[1] == pytest.approx(reference.shown, abs=1e-9)
        moved += state.stem.velocity_m_per_s != 0.0
    assert moved >= 2  # some comparisons were made in flight
