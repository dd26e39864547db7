"""An alarm of the valve's condition on its way: from a kept result to log, status, bus and record."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from several_loop import SeveralLoop

from positioner.cli.main import main
from positioner.commissioning.results import keep
from positioner.wire.messages import Health, PositionerAlarms, PositionerStatus

if TYPE_CHECKING:
    from pathlib import Path

    import pytest

STUCK = {
    "valve": "FV-1",
    "stop": {"cause": "stuck, breakaway too high", "why": "no motion"},
    "findings": [],
    "verdict": "failed",
}


def test_an_alarm_is_told_once_in_the_log_on_the_bus_and_in_the_record(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    keep(tmp_path / "state" / "FV-1", "stroke-test", STUCK)
    with SeveralLoop(tmp_path, ["FV-1"], record=tmp_path / "bus.log") as loop:
        loop.run_to(1500)
        messages, lines = loop.plants["FV-1"].messages(), loop.lines
    told = [line for line in lines if "alarm: the stroke test" in line]
    assert len(told) == 1
    assert "limit 2 (failure); look at the kept result" in told[0]
    statuses = [each.health for each in messages if isinstance(each, PositionerStatus)]
    assert (statuses[0], statuses[-1]) == (Health.GOOD, Health.FAILURE)
    assert [each for each in messages if isinstance(each, PositionerAlarms)][-1] == PositionerAlarms(
        Health.FAILURE, 1, 1 << 11, 1 << 11
    )
    config = str(tmp_path / "plant.toml")
    capsys.readouterr()
    assert main(["replay", str(tmp_path / "bus.log"), "--config", config]) == 0, capsys.readouterr()
    capsys.readouterr()
    assert main(["health", "--config", config, "--json"]) == 1
    (alarm,) = json.loads(capsys.readouterr().out)["alarms"]
    assert (alarm["cause"], alarm["category"], alarm["since"][-1]) == ("stroke_test", "failure", "Z")
