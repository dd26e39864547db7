"""The bench on a virtual CAN interface: the same numbers as anywhere in lockstep, and a loop in real time."""

from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING

import numpy as np
import printed
import pytest
from harness.plan import kind_inside
from links import command, vcan

from positioner.bench.inprocess import run_in_process
from positioner.bench.scenario import load_scenario

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.kernel("vcan")
LOCKSTEP = """
name = "lockstep"
title = "three setpoints, a fifth of a second each"
law = "nmpc"
setpoints_mm = [73.0, 87.0, 80.0]
dwell_s = 0.2
seed = 7
"""
REAL_TIME = """
name = "real-time"
title = "thirty seconds at 100 Hz"
law = "nmpc"
sample_period_s = 0.01
setpoint_period_s = 0.05
setpoints_mm = [73.0, 87.0, 80.0]
visits = 2
dwell_s = 5.0
seed = 7
plant = { deadman_s = 20.0 }
guard = { feedback_hold_periods = 800, feedback_failsafe_periods = 8000, setpoint_hold_s = 0, setpoint_failsafe_s = 0 }
"""


def bench(folder: Path, text: str, bus: str, *more: str) -> dict[str, object]:
    """Return the result of `positioner bench` without its table `run`, which differs each time."""
    scenario = folder / "scenario.toml"
    scenario.write_text(text, encoding="utf-8")
    out = folder / bus.replace(":", "-")
    words = ["bench", "--scenario", str(scenario), "--bus", bus, "--out", str(out), *more]
    command(sys.executable, "-m", "positioner", *words)
    result: dict[str, object] = json.loads((out / "result.json").read_text(encoding="utf-8"))
    result.pop("run")
    return result


def test_lockstep_gives_the_numbers_of_the_embedded_bus_and_of_none(tmp_path: Path) -> None:
    with vcan() as address:
        real = bench(tmp_path, LOCKSTEP, str(address))
    if kind_inside():  # where nobody has set the network up
        command("ip", "link", "set", "lo", "multicast", "on")
        command("ip", "route", "replace", "224.0.0.0/4", "dev", "lo")
    embedded = "udp_multicast:239.255.7.7@43999"
    assert bench(tmp_path, LOCKSTEP, embedded) == real
    logs = [tmp_path / name.replace(":", "-") / "bus.log" for name in (str(address), embedded)]
    assert logs[0].read_bytes() == logs[1].read_bytes()
    run = run_in_process(load_scenario(str(tmp_path / "scenario.toml")))
    run.recording.write_log(tmp_path / "bus.log")
    assert (tmp_path / "bus.log").read_bytes() == logs[0].read_bytes()


@pytest.mark.slow(short="bus/test_bus_embedded.py::test_a_virtual_can_interface_is_found_when_it_is_up")
def test_a_vcan_that_is_up_is_found_and_used(tmp_path: Path) -> None:
    scenario = tmp_path / "scenario.toml"
    scenario.write_text(LOCKSTEP.replace("87.0, 80.0", "87.0"), encoding="utf-8")
    with vcan() as address:
        words = ["bench", "--scenario", str(scenario), "--out", str(tmp_path / "out")]
        output = command(sys.executable, "-m", "positioner", *words)
    name = address.channel if kind_inside() else "vcan"  # a host may have one of its own
    assert f"bus socketcan:{name}" in output
    assert printed.FOUND_VCAN in output


@pytest.mark.slow(short="bench/test_bench_run.py::test_a_run_in_real_time_closes_the_loop")
def test_thirty_seconds_in_real_time_at_100_hz_close_the_loop(tmp_path: Path) -> None:
    with vcan() as address:
        result = bench(tmp_path, REAL_TIME, str(address), "--clock", "realtime")
    dwells = result["dwells"]
    assert isinstance(dwells, list)
    errors = np.array([dwell["mean_abs_error_pct"] for dwell in dwells])
    assert len(errors) == 6
    # a loop that is open rests tens of percent away; one that closes, however late its frames, within a few
    assert float(np.median(errors)) < 2.0
