"""Generalised Maxwell-slip friction against an independent integrator, closed forms, and its published behaviour."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from elastic_contact import MOVES, dragged, played, quiet
from scipy.integrate import solve_ivp

from plant_emulator import valve
from plant_emulator.valve import friction_n, initial_state

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

PLANT = quiet("maxwell-slip", 0.0)
F_S, F_C, V_S, F_V = 1707.7, 1423.0, 0.000254, 612.9
SHARES = np.array([0.25, 0.25, 0.25, 0.25])
SPRINGS = 1.423e8 * np.array([0.67, 0.19, 0.09, 0.05])
DAMPING, ATTRACTION = 13917.0 * np.array([0.67, 0.19, 0.09, 0.05]), 1.4e5


def _curve(speed: float) -> float:
    return F_C + (F_S - F_C) * math.exp(-((speed / V_S) ** 2))


def _virgin_n(x: Any) -> NDArray[np.float64]:
    """Return the force in N of a slow deflection of fresh elements: each a spring up to its share of F_s."""
    return np.array(np.minimum(SPRINGS[:, None] * x, SHARES[:, None] * F_S).sum(axis=0))


def _event(element: int, way: int) -> Callable[[float, NDArray[np.float64]], float]:
    """Return the function of t and y that passes 0 where this element begins to slip this way."""

    def reached(_: float, y: NDArray[np.float64]) -> float:
        return float(way * y[2 + element] - SHARES[element] * _curve(y[1])) if way * y[1] >= 0.0 else -1.0

    reached.terminal, reached.direction = True, 1  # type: ignore[attr-defined]
    return reached


def _turning(way: int) -> Callable[[float, NDArray[np.float64]], float]:
    def turned(_: float, y: NDArray[np.float64]) -> float:
        return float(way * y[1])

    turned.terminal, turned.direction = True, -1  # type: ignore[attr-defined]
    return turned


def _integrated(lag_s: float) -> NDArray[np.float64]:
    """Return the positions after each ms of `MOVES` by SciPy, each change of an element an event."""
    area, gain, spring, mass = 0.06452, 5171.06775, 52538.0, 1.361
    y, pressure_pa, slipping, found = np.array([0.01, *[0.0] * 5]), spring * 0.01 / area, np.zeros(4), []
    for current_ma, seconds in MOVES:
        target_pa, begun_pa, now_s = gain * current_ma, pressure_pa, 0.0
        ends = np.arange(1, round(seconds / 1e-3) + 1) * 1e-3
        positions = np.zeros(ends.size)
        while now_s < seconds:

            def slopes(t: float, y: NDArray[np.float64], known: Any = (target_pa, begun_pa, slipping)) -> Any:
                target, begun, ways = known
                force = area * (target + (begun - target) * math.exp(-t / lag_s)) - spring * y[0]
                v, forces = y[1], y[2:]
                resisting = forces.sum() + F_V * v + DAMPING[ways == 0.0].sum() * v
                gliding = ways * ATTRACTION * (SHARES - ways * forces / _curve(v))
                return [v, (force - resisting) / mass, *np.where(ways == 0.0, SPRINGS * v, gliding)]

            events = [(_event(i, way), i, way) for i in range(4) if slipping[i] == 0.0 for way in (1, -1)]
            turns = [(_turning(int(way)), None, 0) for way in slipping[slipping != 0.0][:1]]
            wanted = [*events, *turns]
            solved = solve_ivp(
                slopes, (now_s, seconds), y, "LSODA", dense_output=True, events=[each[0] for each in wanted],
                rtol=1e-9, atol=[1e-12, 1e-9, *[1e-6] * 4], max_step=2e-4,
            )  # fmt: skip
            inside = (ends > now_s) & (ends <= solved.t[-1] + 1e-12)
            positions[inside] = solved.sol(ends[inside])[0] if inside.any() else 0.0
            now_s, y = float(solved.t[-1]), solved.y[:, -1]
            for (_, element, way), instants in zip(wanted, solved.t_events, strict=True):
                if solved.status == 1 and instants.size:
                    slipping = slipping.copy()
                    slipping[slice(None) if element is None else element] = way
        found.append(positions)
        pressure_pa = target_pa + (begun_pa - target_pa) * math.exp(-seconds / lag_s)
    return np.concatenate(found)


def test_moves_are_those_of_an_independent_integrator() -> None:
    ours, theirs = played(quiet("maxwell-slip", 0.03), 1e-3), _integrated(0.03)
    assert 0.02 < np.ptp(theirs) < 0.06
    assert np.abs(ours - theirs).max() < 6e-6


@pytest.mark.parametrize("period_s", [1e-4, 5e-3])
def test_the_result_hardly_depends_on_how_the_time_is_divided(period_s: float) -> None:
    settings = quiet("maxwell-slip", 0.01)
    one, other = played(settings, 1e-3), played(settings, period_s)
    if period_s < 1e-3:
        other = other[9::10]
    else:
        one = one[4::5]
    assert np.abs(one - other).max() < 6e-6


def _deflected(*legs: tuple[float, int]) -> NDArray[np.float64]:
    """Return the forces in N while the stem is dragged by 1 µm/s in steps of 10 nm: (way, steps) each."""
    step_s = 0.01
    velocities = np.concatenate([np.full(steps, way * 1e-6) for way, steps in legs])
    forces = dragged(PLANT, velocities, step_s)
    return forces - F_V * velocities


def test_a_first_deflection_follows_the_virgin_curve_and_its_way_back_the_doubled_one() -> None:
    """Masing's rule; half of each step and the damping of a slow motion are allowed for."""
    forces = _deflected((1.0, 4000), (-1.0, 3000))
    x = (np.arange(4000) + 0.5) * 1e-8
    assert forces[:4000] == pytest.approx(_virgin_n(x), abs=0.6)
    back = (np.arange(3000) + 0.5) * 1e-8
    turned_n = float(_virgin_n(np.array([4000e-8]))[0])
    assert forces[4000:] == pytest.approx(turned_n - 2.0 * _virgin_n(back / 2.0), abs=0.6)


def test_a_closed_inner_loop_is_forgotten() -> None:
    """The memory is not local: the force returns to the outer curve as if the inner loop had not been."""
    plain = _deflected((1.0, 3000))
    looped = _deflected((1.0, 1500), (-1.0, 600), (1.0, 300), (-1.0, 300), (1.0, 2100))
    assert looped[-1500:] == pytest.approx(plain[-1500:], abs=0.05)
    inner = looped[1500:3300]
    assert np.ptp(inner) > 100.0


def test_steady_sliding_is_on_stribecks_curve() -> None:
    for speed in (1e-5, 2e-4, 5e-4, 1e-2, 0.5):
        forces = dragged(PLANT, np.full(2000, speed), max(1e-7 / speed, 1e-4))
        assert forces[-1] == pytest.approx(_curve(speed) + F_V * speed, rel=1e-6)


def test_friction_lags_behind_the_speed() -> None:
    """At the same speed it is smaller while the stem slows down."""
    step_s, hertz = 1e-4, 10.0
    time = np.arange(round(0.4 / step_s)) * step_s
    forces = dragged(PLANT, V_S * (1.5 - np.cos(math.tau * hertz * time)), step_s)[-1000:]
    faster, slower = forces[:500][125:375], forces[500:][::-1][125:375]
    assert np.all(faster - slower > 10.0)
    assert np.all(faster - slower < F_S - F_C)


def test_a_stem_at_rest_holds_its_force_and_needs_one_step_for_an_hour() -> None:
    state = initial_state(PLANT, 1)
    for _ in range(2):
        state = valve.step(PLANT, state, 6.0, 0.5)
    later = valve.step(PLANT, state, 6.0, 3600.0)
    assert later.stem is state.stem
    assert later.stem.direction == 0
    push_n = 0.06452 * 5171.06775 * 6.0
    assert friction_n(PLANT, later) == pytest.approx(push_n - 52538.0 * later.stem.position_m, abs=0.01)


def test_counters_follow_the_stick_velocity() -> None:
    settings, state = quiet("maxwell-slip", 0.05), initial_state(PLANT, 1)
    for current_ma in (8.0, 12.0, 6.0):
        state = valve.step(settings, state, current_ma, 1.0)
        assert state.stem.direction == 0
    assert (state.stem.slips, state.stem.stops, state.stem.reversals) == (3, 3, 1)
