"""The examples that carry metrics on: what a broker and an OPC UA server get from them."""

from __future__ import annotations

import asyncio
import importlib.util
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import TYPE_CHECKING, Any, ClassVar, Self

import pytest
from test_metrics_text import KEPT, busy_state, snapshot

from positioner.metrics.exposition import text_of

if TYPE_CHECKING:
    from collections.abc import Callable

SNAPSHOT = snapshot(busy_state(), kept=KEPT)
EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


class StopBridgeError(Exception):
    """Ends the endless loop of a bridge."""


def bridge(name: str, monkeypatch: pytest.MonkeyPatch, **modules: Any) -> ModuleType:
    """Return the example, with fakes in the place of what it imports."""
    assert len((EXAMPLES / f"{name}.py").read_text("utf-8").splitlines()) <= 40
    for module, content in modules.items():
        parts = module.split("__")
        for count in range(1, len(parts) + 1):
            fake = ModuleType(".".join(parts[:count]))
            fake.__dict__.update(content if count == len(parts) else {})
            monkeypatch.setitem(sys.modules, fake.__name__, fake)
            if count > 1:
                setattr(sys.modules[".".join(parts[: count - 1])], parts[count - 1], fake)
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    return made


def written(path: Path, told: dict[str, Any]) -> None:
    path.write_text(text_of([told], "1"), "utf-8")


def after(rounds: list[Callable[[], object]]) -> Callable[[float], None]:
    """Return a sleep that does one thing after the other, and then ends the bridge."""

    def sleep(_duration_s: float) -> None:
        if not rounds:
            raise StopBridgeError
        rounds.pop(0)()

    return sleep


def test_mqtt_gets_what_changed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    published: list[tuple[str, str]] = []
    client = SimpleNamespace(
        connect=lambda broker: published.append(("connected", broker)),
        loop_start=lambda: None,
        publish=lambda topic, number, retain: published.append((topic, number)) if retain else None,
    )
    mqtt = {"Client": lambda _version: client, "CallbackAPIVersion": SimpleNamespace(VERSION2=2)}
    example = bridge("mqtt_bridge", monkeypatch, paho__mqtt__client=mqtt)
    path = tmp_path / "metrics.prom"
    later = SNAPSHOT | {"current_ma": 13.5}
    rounds: list[Callable[[], object]] = [lambda: written(path, SNAPSHOT), lambda: written(path, later)]
    monkeypatch.setattr(example.time, "sleep", after(rounds))
    with pytest.raises(StopBridgeError):
        example.main(str(path), "broker.example")
    assert published[0] == ("connected", "broker.example")
    assert ("positioner/FV-101/setpoint_meters", "0.062") in published
    assert ("positioner/FV-101/mode/hold", "1") in published
    assert published[-1] == ("positioner/FV-101/current_amperes", "0.0135")
    assert len(published) == len(set(published))


class FakeNode:
    """A node of an OPC UA server."""

    def __init__(self, values: dict[str, float], name: str) -> None:
        self.values, self.name = values, name

    async def add_folder(self, _space: int, name: str) -> FakeNode:
        return FakeNode(self.values, name)

    async def add_variable(self, _space: int, name: str, _value: float) -> FakeNode:
        return FakeNode(self.values, f"{self.name}/{name}")

    async def write_value(self, value: float) -> None:
        self.values[self.name] = value


class FakeServer:
    """An OPC UA server; `values` are those of its variables."""

    values: ClassVar[dict[str, float]] = {}

    def __init__(self) -> None:
        self.nodes = SimpleNamespace(objects=FakeNode(self.values, "Objects"))

    async def init(self) -> None:
        pass

    def set_endpoint(self, endpoint: str) -> None:
        assert endpoint == "opc.tcp://127.0.0.1:4840"

    async def register_namespace(self, _name: str) -> int:
        return 2

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        pass


def test_opc_ua_offers_each_metric(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    example = bridge("opcua_bridge", monkeypatch, asyncua={"Server": FakeServer})
    path = tmp_path / "metrics.prom"
    sleep = after([lambda: written(path, SNAPSHOT)])

    async def slept(duration_s: float) -> None:
        sleep(duration_s)

    monkeypatch.setattr(example.asyncio, "sleep", slept)
    with pytest.raises(StopBridgeError):
        asyncio.run(example.main(str(path), "opc.tcp://127.0.0.1:4840"))
    assert FakeServer.values["FV-101/setpoint_meters"] == 0.062
    assert FakeServer.values["FV-101/mode.hold"] == 1.0
    assert FakeServer.values["FV-101/mode.active"] == 0.0
