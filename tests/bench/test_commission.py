"""A bench that identifies its valve first: the order of the processes, what is said, and a failure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Self

import pytest

from positioner.bench import commission
from positioner.bench.inprocess import configure
from positioner.bench.play import BenchOptions
from positioner.bench.scenario import load_scenario, scenario_names
from positioner.errors import BenchError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path


class Command:
    """A process that has ended, with a log."""

    happened: list[str]
    status = 0

    def __init__(self, module: str, arguments: Sequence[str], log: Path) -> None:
        self.log, self.process, self.returncode = log, self, self.status
        self.name = arguments[0] if module.startswith("positioner") else "plant"
        self.happened.append(f"{self.name} begins: {' '.join(arguments[1:])}")
        log.write_text(f"the words of {self.name}\n", encoding="utf-8")

    def wait_for(self, field: str) -> None:
        self.happened.append(f"{self.name}: {field}")

    def poll(self) -> int:
        return self.returncode

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self.happened.append(f"{self.name} ends")


@pytest.fixture
def happened(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    happened: list[str] = []
    monkeypatch.setattr(Command, "happened", happened, raising=False)
    monkeypatch.setattr(commission, "BenchProcess", Command)
    return happened


def _commission(out: Path) -> list[str]:
    said: list[str] = []
    scenario = load_scenario("real-valve")
    options = BenchOptions(bus=None, lockstep=True, out=out, state=None)
    commission.commission(scenario, options, configure(scenario), lambda text: said.append(str(text)))
    return said


def test_the_valve_is_identified_on_the_bus_and_then_its_reach_is_computed(happened: list[str], tmp_path: Path) -> None:
    said = _commission(tmp_path)
    valve = f"--config {tmp_path / 'valve.toml'}"
    # in lockstep the emulator sends its first frame once: whoever is to answer must listen already
    assert happened[0].startswith(f"identify begins: {valve} --yes --write --clock lockstep")
    assert happened[1] == "identify: waiting for position frames"
    assert happened[2].startswith(f"plant begins: --config {tmp_path / 'plant.toml'} --clock lockstep --seed 1")
    assert happened[3:] == ["plant ends", "identify ends", f"reach begins: {valve}", "reach ends"]
    assert said[1:] == ["the words of identify", "the words of reach"]


def test_an_identification_that_fails_ends_the_bench(
    happened: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Command, "status", 1)
    with pytest.raises(BenchError, match=r"identify ended with status 1; its log is .*identify\.log"):
        _commission(tmp_path)
    assert not any("reach" in line for line in happened)


def test_only_the_real_valve_is_identified_and_it_begins_with_another_valve() -> None:
    assert [name for name in scenario_names() if load_scenario(name).commission] == ["real-valve"]
    valve = configure(load_scenario("real-valve")).valve
    assert (valve.spring_rate_n_per_m, valve.static_friction_n) == (60000.0, 1400.0)
    assert valve.actuator.is_immediate
