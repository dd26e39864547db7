"""The doctor's measurement of a cycle: what it says of given durations, and the valve that it plays."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING

import pytest

from positioner.config.reader import parse_config
from positioner.doctor import cycle_time
from positioner.doctor.cycle_time import CycleTime, findings, measure, of_any_valve
from positioner.doctor.finding import Level
from positioner.reach.case import Case

if TYPE_CHECKING:
    from positioner.config.schema import Configuration


def configured(period_s: float = 1e-3, valve: str = "paper", law: str = "nmpc") -> Configuration:
    text = f'[valve]\nid = "v"\npreset = "{valve}"\n[control]\nlaw = "{law}"\nsample_period_s = {period_s}\n'
    return parse_config(text, "valve.toml", Path())


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """A clock of processor time: cycle n lasts for n µs."""
    calls: list[int] = []

    def now_ns() -> int:
        calls.append(0)
        cycle, is_end = divmod(len(calls) - 1, 2)
        return 1000 * cycle if is_end else 0

    monkeypatch.setattr(cycle_time, "time", SimpleNamespace(thread_time_ns=now_ns))
    monkeypatch.setattr(cycle_time, "CYCLES", 100)
    monkeypatch.setattr(cycle_time, "FIRST", 10)
    return calls


@pytest.mark.usefixtures("clock")
def test_the_first_cycles_are_not_timed_and_the_99th_of_a_hundred_counts() -> None:
    found = measure(configured())
    assert (found.median_s, found.p99_s, found.longest_s) == pytest.approx((60e-6, 108e-6, 109e-6))
    assert found.cycles == 100
    assert found.shortest_period_s == pytest.approx(140e-6)  # 108/0.8 = 135
    expected = (
        "0.06 ms in the median, 0.11 ms for 99 % of 100 cycles, 0.11 ms the longest; the shortest period for it is"
    )
    assert found.in_words() == f"{expected} 0.14 ms"


@pytest.mark.parametrize(("p99_s", "period_s"), [(8e-4, 1e-3), (8.01e-4, 1.1e-3), (4.1e-3, 5.2e-3), (8e-5, 1e-4)])
def test_the_shortest_period_is_rounded_up_to_two_digits(p99_s: float, period_s: float) -> None:
    assert CycleTime(p99_s / 4.0, p99_s, p99_s, 1000).shortest_period_s == pytest.approx(period_s)


def test_a_clock_that_is_too_coarse_for_a_cycle_is_borne() -> None:
    found = CycleTime(0.0, 0.0, 0.01, 1000)
    assert found.shortest_period_s == pytest.approx(1.3e-6)  # 1/0.8 = 1.25
    assert found.in_words().startswith("0 s in the median")


@pytest.mark.usefixtures("clock")
def test_a_period_that_is_too_short_is_a_warning_with_what_helps(monkeypatch: pytest.MonkeyPatch) -> None:
    path = Path("valve.toml")
    fitting, other = findings(configured(1.4e-4, "real-valve"), path)
    assert (fitting.level, fitting.fix) == (Level.OK, "")
    assert fitting.text.startswith("nmpc with fill 50 ms, vent 50 ms, ")
    assert other.text.startswith("nmpc without lag, ")
    warned, other = findings(configured(1.2e-4), path)
    assert (warned.level, other.level) == (Level.WARN, Level.OK)
    assert other.text.startswith("nmpc with fill 50 ms, vent 50 ms, ")
    monkeypatch.setattr(cycle_time, "is_compiled", lambda: True)
    warned, _ = findings(configured(1e-5), path)
    assert warned.text.startswith("nmpc without lag, compiled: ")
    assert warned.text.endswith(", and the configured one of 0.01 ms is too short")
    assert warned.fix == "positioner reach --config valve.toml  # what a longer control.sample_period_s reaches"


def test_a_law_of_another_kind_is_timed_as_it_is_configured(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cycle_time, "CYCLES", 10)
    (found,) = findings(configured(law="pi"), Path("valve.toml"))
    assert found.text.startswith("pi, ")
    assert len(list(of_any_valve())) == 2


@pytest.mark.parametrize("valve", ["paper", "real-valve"])
def test_the_law_moves_the_stem_of_the_model_to_its_setpoints(valve: str, monkeypatch: pytest.MonkeyPatch) -> None:
    places: list[float] = []
    plain = cycle_time._Stem.move

    def noted(self: cycle_time._Stem, current_ma: float) -> None:
        plain(self, current_ma)
        places.append(self.x)

    monkeypatch.setattr(cycle_time._Stem, "move", noted)
    # long dwells: at 2 % noise a stem that slips too far once waits for its correction
    monkeypatch.setattr(cycle_time, "_EVERY", 400)
    monkeypatch.setattr(cycle_time, "CYCLES", 1598)
    monkeypatch.setattr(cycle_time, "LONGEST_S", math.inf)
    configuration = configured(valve=valve)
    measure(configuration)
    middle_m = Case.of(configuration).middle_m
    ends = [places[cycle] - middle_m for cycle in (799, 1199, 1599)]  # the first move measures the valve
    assert ends == pytest.approx([0.00635, 0.0, 0.00635], abs=0.0015)


def test_a_stem_that_is_freed_jumps_by_the_natural_jump() -> None:
    stem = cycle_time._Stem(Case.of(configured()))
    start_m, gain = stem.x, 0.06452 * 0.75 * 6894.757
    stem.move((52538.0 * start_m + 1707.0) / gain)
    assert stem.x == start_m
    for _ in range(200):
        stem.move((52538.0 * start_m + 1708.0) / gain)
    assert stem.x - start_m == pytest.approx(284.7 / 52538.0, rel=0.02)
