"""A plant with its own physics: what of it counts, what is added to it, and one line for whatever its code does."""

from __future__ import annotations

import math
import signal
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from plant_emulator import valve
from plant_emulator.cli.main import main
from plant_emulator.own_stem import following
from plant_emulator.plants import complete_tables, plant_in_file, plant_named
from plant_emulator.presets import plant_settings
from plant_emulator.stem import Stem
from positioner.errors import ConfigurationError, ExitCode

if TYPE_CHECKING:
    from plant_emulator.parameters import PlantSettings

ROOT = Path(__file__).resolve().parents[2]
LUGRE = f"{ROOT}/examples/my_plant.py:LuGre"
CART = """
class Cart:
    '''Moves with 1 mm/s for each mA above 12; shows 2 mm more than there is.'''
    TABLES
    def begin(self, seed):
        return [0.05 + seed * 1e-3, 0.0]
    def advance(self, state, current_ma, seconds):
        x, _ = state
        speed = 1e-3 * (current_ma - 12.0)
        ADVANCE
        return [x + speed * seconds, speed]
    def reading(self, state):
        READING
        return state[0] + 0.002
    def truth(self, state):
        TRUTH
        return state
"""


def written(folder: Path, after: str = "", **lines: str) -> str:
    """Return the name of a cart in a file of `folder`, with these lines in its methods."""
    text = CART
    for word in ("TABLES", "ADVANCE", "READING", "TRUTH"):
        text = text.replace(word, lines.get(word, "pass"))
    (folder / "cart.py").write_text(text + after, encoding="utf-8")
    return f"{folder}/cart.py:Cart"


def played(settings: PlantSettings, *steps: tuple[float, float], seed: int = 1) -> valve.PlantState:
    state = valve.initial_state(settings, seed)
    for current_ma, seconds in steps:
        state = valve.step(settings, state, current_ma, seconds)
    return state


def test_the_stem_goes_where_the_physics_says_and_the_sensor_shows_its_reading(tmp_path: Path) -> None:
    settings = plant_named(written(tmp_path))
    state = played(settings, (14.0, 2.0), (13.0, 0.5), seed=3)
    assert state.time_s == 2.5
    assert state.stem.position_m == pytest.approx(0.053 + 2.0 * 2e-3 + 0.5 * 1e-3, abs=1e-15)
    assert state.stem.velocity_m_per_s == pytest.approx(1e-3)
    assert state.actuator.line.newest_ma == 13.0
    assert valve.measure(settings, state)[1] == pytest.approx(state.stem.position_m + 0.002, abs=1e-15)
    assert math.isnan(valve.friction_n(settings, state))
    assert math.isnan(state.actuator.pressure_pa)


def test_a_run_begins_with_a_state_of_its_own_and_steps_of_no_time_change_nothing(tmp_path: Path) -> None:
    settings = plant_named(written(tmp_path, ADVANCE="assert seconds > 0.0"))
    first, second = valve.initial_state(settings, 1), valve.initial_state(settings, 1)
    first = valve.step(settings, first, 20.0, 1.0)
    assert valve.step(settings, first, 20.0, 0.0) is first
    assert [first.stem.position_m, second.stem.position_m] == pytest.approx([0.059, 0.051])
    held = valve.held_state(settings, 1, 7.0)
    assert [held.stem.position_m, held.actuator.line.newest_ma] == pytest.approx([0.051, 7.0])


def test_noise_zero_and_resolution_of_the_tables_are_added_to_the_reading_and_without_them_nothing_is(
    tmp_path: Path,
) -> None:
    bare = plant_named(written(tmp_path))
    assert (bare.sensor.noise_of_reading, bare.sensor.noise_of_span) == (0.0, 0.0)  # and not the 2 % of `paper`
    table = "tables = {'sensor': {'zero_m': 0.01, 'resolution_m': 0.005, 'noise_of_span': 0.1}}"
    settings = plant_named(written(tmp_path, TABLES=table))
    state = valve.initial_state(settings, 1)
    shown = []
    for _ in range(400):
        state, shown_m = valve.measure(settings, state)
        shown.append(shown_m)
    assert np.mean(shown) == pytest.approx(0.051 + 0.002 + 0.01, abs=4 * 0.0127 / 20)
    assert 0.9 < np.std(shown) / 0.0127 < 1.1
    assert np.abs(np.array(shown) / 0.005 - np.round(np.array(shown) / 0.005)).max() < 1e-9
    drifts = "tables = {'schedule': [{'at_s': 1.0, 'key': 'sensor.zero_m', 'value': 0.02}]}"
    settings = plant_named(written(tmp_path, TABLES=drifts))
    assert valve.measure(settings, played(settings, (12.0, 0.5)))[1] == pytest.approx(0.053)
    assert valve.measure(settings, played(settings, (12.0, 1.5)))[1] == pytest.approx(0.073)


def test_slips_stops_reversals_and_travel_are_counted_by_the_stick_velocity() -> None:
    speeds = (0.0, 1.0, 2.0, 2.0, 0.3, 3.0, -2.0, -0.1, 0.0, -2.0)  # times the stick velocity
    stem, x = Stem(position_m=0.05), 0.05
    for speed in speeds:
        x += speed * 1e-3
        stem = following(stem, x, speed * 1e-4, 1e-4)
    # starts at 2, 3 and -2 (the last one); the turn from 3 to -2 is no start; it rests at 0.3 and at -0.1
    assert (stem.slips, stem.stops, stem.reversals) == (3, 2, 1)
    assert stem.travel_m == pytest.approx(1e-3 * sum(map(abs, speeds)))
    assert (stem.direction, stem.last_direction) == (-1, -1)
    rests = following(stem, x, 0.0, 1e-4)
    assert (rests.direction, rests.last_direction, rests.stops) == (0, -1, 3)


def test_the_example_is_lugre_as_an_independent_integrator_plays_it() -> None:
    lines = (ROOT / "examples" / "my_plant.py").read_text(encoding="utf-8").splitlines()
    assert len(lines) <= 45
    settings = plant_named(LUGRE)
    state, path = valve.initial_state(settings, 1), []
    for _ in range(100):
        state = valve.step(settings, state, 14.5, 1e-3)
        path.append((state.time_s, state.stem.position_m))

    def slope(_t: float, y: Any) -> list[float]:
        x, v, z = y
        g = 1423.0 + (1707.7 - 1423.0) * math.exp(-((v / 0.002) ** 2))
        dz = v - 2e7 * abs(v) / g * z
        force_n = 0.06452 * 5171.07 * 14.5 - 52538.0 * x - (2e7 * z + 5e3 * dz + 612.9 * v)
        return [v, force_n / 1.361, dz]

    times = [time_s for time_s, _ in path]
    found = solve_ivp(slope, (0.0, times[-1]), [0.05, 0.0, 0.0], "LSODA", t_eval=times, rtol=1e-9, atol=1e-12)
    error_m = np.abs(found.y[0] - [position_m for _, position_m in path])
    moved_m = path[-1][1] - 0.05
    assert 0.01 < moved_m < 0.03
    assert error_m.max() < 0.004 * moved_m  # of the first order, at steps of 20 µs
    assert error_m.max() > 0.0


def test_a_class_an_object_and_a_function_that_makes_one_are_plants(tmp_path: Path) -> None:
    after = "cart = Cart()\ndef make():\n    return Cart()\n"
    name = written(tmp_path, after, TABLES="tables = {'preset': 'graphite', 'deadman_s': 0.2}")
    for each in ("Cart", "cart", "make"):
        settings = plant_named(f"{tmp_path}/cart.py:{each}")
        assert settings.physics == f"{tmp_path}/cart.py:{each}"
        assert (settings.preset, settings.deadman_s) == ("graphite", 0.2)
        assert settings.valve == plant_settings("graphite").valve
        assert settings.sensor.noise_of_reading == 0.0
        assert played(settings, (13.0, 1.0)).stem.position_m == pytest.approx(0.052)
    own = written(tmp_path, TABLES="@property\n    def tables(self): return {'deadman_s': 0.3}")
    assert plant_named(own).deadman_s == 0.3
    assert plant_settings(overrides=complete_tables(plant_named(name))) == plant_named(name)


def test_a_plant_file_names_physics_beside_it_and_a_relative_name_is_made_absolute(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written(tmp_path, TABLES="tables = {'deadman_s': 0.2}")
    file = tmp_path / "plant.toml"
    file.write_text('preset = "noise-free"\nphysics = "cart.py:Cart"\n', encoding="utf-8")
    settings = plant_in_file(file, {"deadman_s": 0.5})
    assert (settings.physics, settings.deadman_s) == (f"{tmp_path}/cart.py:Cart", 0.5)
    assert plant_named(str(file)).deadman_s == 0.1  # a plant file is whole: it has its own tables
    monkeypatch.chdir(tmp_path)
    assert plant_named("cart.py:Cart").physics == f"{tmp_path}/cart.py:Cart"
    assert plant_named("plant.toml").physics == f"{tmp_path}/cart.py:Cart"


def test_an_edited_file_is_played_as_it_is_now(tmp_path: Path) -> None:
    settings = plant_named(written(tmp_path))
    assert played(settings, (13.0, 1.0)).stem.position_m == pytest.approx(0.052)
    written(tmp_path, ADVANCE="speed = 5e-3")
    assert played(settings, (13.0, 1.0)).stem.position_m == pytest.approx(0.056)


@pytest.mark.parametrize(
    ("tables", "expected"),
    [
        ({"process": {"force_n": 3.0}}, "[process] does not act on a plant with its own physics"),
        ({"packing": {"growth_per_decade": 0.1}}, "[packing] does not act on a plant with its own physics"),
        ({"stochastic": {"friction_fraction": 0.1}}, "[stochastic] does not act on a plant with its own physics"),
        ({"sensor": {"reports_pressure": True}}, "sensor.reports_pressure: a plant with its own physics has no"),
        (
            {"schedule": [{"at_s": 1.0, "key": "valve.static_friction_n", "value": 3000.0}]},
            "schedule: valve.static_friction_n does not act on a plant with its own physics; sensor.zero_m,",
        ),
    ],
)
def test_what_acts_in_the_emulators_physics_alone_is_refused(tables: dict[str, Any], expected: str) -> None:
    plant_settings(overrides=tables)
    with pytest.raises(ConfigurationError) as caught:
        plant_settings(overrides={**tables, "physics": LUGRE})
    (line,) = str(caught.value).splitlines()
    assert expected in line


LATE = "if current_ma > 12.5:"
HOSTILE = (
    ({"ADVANCE": f"{LATE} 1 / 0"}, "line 10: advance at 0.25 s: ZeroDivisionError: division by zero: mend it"),
    ({"ADVANCE": f"{LATE} raise SystemExit(0)"}, "line 10: advance at 0.25 s: SystemExit: 0"),
    ({"ADVANCE": f"{LATE} raise GeneratorExit"}, "line 10: advance at 0.25 s: GeneratorExit"),
    ({"ADVANCE": f"{LATE} raise type('E', (BaseException,), {{'__str__': lambda e: 1 / 0}})"}, "its text cannot be"),
    ({"ADVANCE": f"{LATE} raise ValueError('a\\nb\\x1b[2J')"}, "advance at 0.25 s: ValueError: a b\\u001b[2J"),
    ({"ADVANCE": f"{LATE} return None"}, "advance at 0.25 s: returns None: return the state that comes next"),
    ({"ADVANCE": f"{LATE} (lambda f: f(f))(lambda f: f(f))"}, "advance at 0.25 s: RecursionError"),
    ({"TRUTH": "if state[1]: return state[0]"}, "truth at 0.5 s: returns no pair"),
    ({"TRUTH": "if state[1]: return state[0], 0.0, 0.0"}, "truth at 0.5 s: returns no pair"),
    ({"TRUTH": "if state[1]: return float('nan'), 0.0"}, "truth at 0.5 s: returns the position nan: it must be finite"),
    ({"TRUTH": "if state[1]: return 0.05, float('inf')"}, "truth at 0.5 s: returns the velocity inf"),
    ({"TRUTH": "if state[1]: return 50.1, 0.0"}, "returns the position 50.1 m, beyond -1 to 1 m: return it in m"),
    ({"TRUTH": "if state[1]: return '0.05', 0.0"}, "truth at 0.5 s: returns a str as position: return a number"),
    ({"TRUTH": "if state[1]: return True, 0.0"}, "returns a bool as position"),
    ({"TRUTH": "if state[1]: state = int('x')"}, "line 16: truth at 0.5 s: ValueError: invalid literal"),
    ({"READING": "if state[1]: return None"}, "reading at 0.5 s: returns a NoneType as position"),
    ({"READING": "if state[1]: return 1j"}, "reading at 0.5 s: returns a complex as position"),
    ({"READING": "if state[1]: return float('-inf')"}, "reading at 0.5 s: returns the position -inf"),
    ({"READING": "if state[1]: return type('N', (), {'__float__': lambda n: exit(3)})()"}, "SystemExit: 3"),
)


@pytest.mark.parametrize(("lines", "expected"), HOSTILE, ids=[expected for _, expected in HOSTILE])
def test_whatever_the_code_does_is_one_line_with_its_place(
    lines: dict[str, str], expected: str, tmp_path: Path
) -> None:
    name = written(tmp_path, **lines)
    settings = plant_named(name)
    state, _ = valve.measure(settings, played(settings, (12.0, 0.25)))
    with pytest.raises(ConfigurationError) as caught:
        valve.measure(settings, valve.step(settings, state, 13.0, 0.25))
    (line,) = str(caught.value).splitlines()
    assert line.startswith(f"{name}: ")
    assert expected in line


NO_PLANT = (
    ("plant = 3\n", "is a int; a plant is the tables of a plant file, a function that returns them, or physics"),
    ("def plant():\n    raise SystemExit(0)\n", "plant: cannot be made: SystemExit: 0"),
    ("class plant:\n    def __init__(self):\n        1 / 0\n", "line 3: plant: cannot be made: ZeroDivisionError"),
    ("class plant:\n    def __init__(self, file):\n        pass\n", "plant: cannot be made: TypeError"),
    (
        "class plant:\n    begin = truth = advance = lambda *_: 0\n",
        "plant: has begin and advance and truth, but no reading: docs/own-plant.md shows what physics is",
    ),
    (
        "class plant:\n    begin = truth = advance = reading = lambda *_: 0\n    tables = 3\n",
        "tables: is a int; it must be the tables of a plant file",
    ),
    (
        "class plant:\n    begin = truth = advance = reading = lambda *_: 0\n    tables = {'valve': {'mass': 1}}\n",
        "valve.mass: unknown key; did you mean 'mass_kg'?",
    ),
    ("plant = {}\nplant['valve'] = plant\n", "tables: cannot be read: ValueError: Circular reference detected; give"),
    (
        "T = {}\nT['valve'] = T\nclass plant:\n    begin = truth = advance = reading = lambda *_: 0\n    tables = T\n",
        "tables: cannot be read: ValueError: Circular reference detected; give plain tables",
    ),
    ("class plant:\n    def __getattr__(self, name): raise KeyError(name)\n", "cannot be made: KeyError: 'begin'"),
)


@pytest.mark.parametrize(("text", "expected"), NO_PLANT, ids=[expected for _, expected in NO_PLANT])
def test_what_is_no_plant_is_one_line_and_an_exit_status_in_the_emulator(
    text: str, expected: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "own.py").write_text(text, encoding="utf-8")
    for command in ("simulate", "run"):
        assert main([command, "--plant", f"{tmp_path}/own.py:plant"]) == ExitCode.CONFIG
        (line,) = capsys.readouterr().err.splitlines()
        assert line.startswith(f"plant-emulator: {tmp_path}/own.py:plant: ")
        assert expected in line


def test_physics_that_fail_end_the_emulator_with_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    begins = written(tmp_path, "Cart.begin = lambda self, seed: 1 / 0\n")
    for command in ("simulate", "run"):
        assert main([command, "--plant", begins]) == ExitCode.CONFIG
        (line,) = capsys.readouterr().err.splitlines()
        assert line.startswith(f"plant-emulator: {begins}: line 18: begin: ZeroDivisionError")
    name = written(tmp_path, ADVANCE="1 / 0")
    assert main(["simulate", "--plant", name, "--duration", "1"]) == ExitCode.CONFIG
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"plant-emulator: {name}: line 10: advance at 0 s: ZeroDivisionError")
    file = tmp_path / "plant.toml"
    file.write_text('preset = "paper"\nphysics = "cart.py:Trolley"\n', encoding="utf-8")
    assert main(["simulate", "--config", str(file), "--duration", "1"]) == ExitCode.CONFIG
    (line,) = capsys.readouterr().err.splitlines()
    assert f"{tmp_path}/cart.py has no Trolley; known: Cart" in line
    for physics, expected in (
        ("cart.py", "names a file: say which plant in it is meant: cart.py:NAME"),
        ("crat", "is unknown; "),
        ("cart.py:TABLES", "physics: is a dict without begin, advance, reading, truth: docs/own-plant.md shows"),
    ):
        with (tmp_path / "cart.py").open("a", encoding="utf-8") as opened:
            opened.write("TABLES = {'preset': 'paper'}\n")
        file.write_text(f'preset = "paper"\nphysics = "{physics}"\n', encoding="utf-8")
        assert main(["simulate", "--config", str(file), "--duration", "1"]) == ExitCode.CONFIG
        (line,) = capsys.readouterr().err.splitlines()
        assert expected in line


def test_simulate_writes_the_motion_of_a_plant_of_others(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    name = written(tmp_path)
    words = ["simulate", "--plant", name, "--input", "ramp", "--duration", "1", "--period", "0.25", "--seed", "4"]
    assert main([*words, "--set", "deadman_s=0.2"]) == ExitCode.OK
    rows = [row.split(",") for row in capsys.readouterr().out.splitlines()[1:]]
    assert [float(row[1]) for row in rows] == [4.0, 4.0, 8.0, 12.0, 16.0]
    moved = [1e3 * (float(after[3]) - float(before[3])) for before, after in pairwise(rows)]
    assert moved == pytest.approx([-2.0, -1.0, 0.0, 1.0])
    assert float(rows[0][3]) == pytest.approx(0.054)
    assert {(row[2], row[5]) for row in rows} == {("nan", "nan")}  # nobody knows its pressure and its friction
    assert main([*words, "--set", "packing.friction_factor=2"]) == ExitCode.CONFIG
    (line,) = capsys.readouterr().err.splitlines()
    assert "[packing] does not act on a plant with its own physics: leave it out" in line


def test_a_persons_interrupt_ends_the_command_and_one_of_the_codes_own_is_its_error(tmp_path: Path) -> None:
    settings = plant_named(written(tmp_path, ADVANCE="import signal; signal.raise_signal(signal.SIGINT)"))
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            played(settings, (12.0, 0.1))
        settings = plant_named(written(tmp_path, ADVANCE="raise KeyboardInterrupt"))
        signal.signal(signal.SIGINT, lambda *_: None)  # as in `plant-emulator run`
        with pytest.raises(ConfigurationError, match="advance at 0 s: KeyboardInterrupt"):
            played(settings, (12.0, 0.1))
    finally:
        signal.signal(signal.SIGINT, before)
