"""The view beside a daemon: on one bus, reading the same state directory, and nothing changes for the daemon."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import pytest
from daemon_helpers import TIMEOUT_S, own_address
from replay_helpers import scenario

from positioner.bench import runner
from positioner.bench.inprocess import run_in_process
from positioner.bench.play import BenchOptions
from positioner.bench.runner import run_bench
from positioner.bus.port import BusPort
from positioner.config.reader import load_valves
from positioner.monitor.live import LiveSource
from positioner.monitor.screen import table_lines

if TYPE_CHECKING:
    from pathlib import Path

    from positioner.monitor.source import Snapshot
    from positioner.wire.messages import CanFrame

CONFIGURATION = '[valve]\nid = "bench"\npreset = "paper"\n[bus]\ninterface = "{}"\nchannel = "{}"\nport = {}\n'


@pytest.mark.bus
def test_a_lockstep_bench_is_the_same_to_the_bit_beside_a_view(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("draw_trend", "draw_moves", "picture_data"):
        monkeypatch.setattr(runner, name, lambda *_: (None, None))  # nobody looks at them here
    address, played = own_address(), scenario(seconds=0.3)
    senders: list[BusPort] = []
    send = BusPort.send

    def told(port: BusPort, frame: CanFrame, deadline_ns: int | None = None) -> bool:
        senders.append(port)
        return send(port, frame, deadline_ns)

    monkeypatch.setattr(BusPort, "send", told)
    path = tmp_path / "listened.toml"
    path.write_text(CONFIGURATION.format(address.interface, address.channel, address.port), "utf-8")
    out = tmp_path / "out"
    source = LiveSource(load_valves(path), {"bench": out / "state"})
    source.start()
    try:
        run_bench(played, BenchOptions(bus=address, lockstep=True, out=out, state=None), lambda _line: None)
        seen = with_table(source)
    finally:
        source.close()
    alone = tmp_path / "alone.log"
    run_in_process(played).recording.write_log(alone)
    assert (out / "bus.log").read_text("utf-8") == alone.read_text("utf-8")
    assert senders  # the host of the bench
    assert not set(senders) & set(source._places)
    assert source.failure is None
    assert sum(each.readings for each in seen.bins) in {300, 301}  # the plant may answer the last command, too
    assert seen.view.seen.lost == seen.view.seen.damaged == seen.view.seen.disordered == 0
    table = seen.table
    assert table is not None
    assert table.samples == sum(sum(row.counts.values()) for row in table.rows) > 0
    lines = [line.plain for line in table_lines(table, 80, seen.view.span_m)]
    assert lines[0].startswith(f"stiction table: {table.samples} samples in {table.cells} cells of 5 mm")
    assert all(len(line) <= 80 for line in lines)
    assert sum(int(digit) for line in lines[1:-1] for digit in line[22:] if digit.isdigit()) == table.samples


def with_table(source: LiveSource) -> Snapshot:
    """Return what is shown once the table has been read."""
    end_s = time.monotonic() + TIMEOUT_S
    while time.monotonic() < end_s:
        found = source.snapshot("bench")
        if found.table is not None and found.table.samples:
            return found
        time.sleep(0.05)
    raise AssertionError
