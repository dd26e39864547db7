"""The table while the daemon runs: learned, kept through trouble, and taken over when somebody else changes it."""

from __future__ import annotations

import resource
import time
from typing import TYPE_CHECKING

import pytest
from daemon_helpers import HERE_M, TIMEOUT_S, Loop

from positioner.errors import ExitCode
from positioner.store import access
from positioner.wire.messages import CurrentCommand, Health, PositionerStatus

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.bus
AUTO = {"auto_arm": True}
LEARNING = {"law": "paper"}
"""This law learns from every edge between sticking and sliding, whatever it had planned."""


def teach(loop: Loop) -> None:
    """Move the stem away and back, so that the table learns something."""
    before = loop.session.state.table.sequence
    for number in range(80):
        loop.sample(HERE_M + 0.001 * min(number, 30, max(60 - number, 0)), setpoint_m=0.1)
    assert loop.session.state.table.sequence > before


def wait_until_saved(loop: Loop) -> None:
    """Let samples pass until the state directory holds the daemon's table."""
    deadline_s = time.monotonic() + TIMEOUT_S
    while access.dump(loop.configuration.state_directory).table != loop.session.state.table:
        assert time.monotonic() < deadline_s, loop.lines
        loop.sample()


def test_what_is_learned_is_on_the_disk_while_the_daemon_runs_and_after_it(tmp_path: Path) -> None:
    with Loop(tmp_path, guard=AUTO, control=LEARNING) as loop:
        teach(loop)
        wait_until_saved(loop)
    assert access.dump(tmp_path / "state").table == loop.session.state.table


def test_the_next_daemon_starts_from_the_table(tmp_path: Path) -> None:
    with Loop(tmp_path, guard=AUTO, control=LEARNING) as first:
        teach(first)
    with Loop(tmp_path, guard=AUTO, control=LEARNING) as second:
        assert second.session.state.table == first.session.state.table
        held = sum(len(cell.samples) for _, cell in second.session.state.table)
        assert second.logged("table of FV-101") == [
            f"table of FV-101: {held} samples in {len(second.session.state.table)} cells"
        ]


def test_a_reset_reaches_the_daemon_by_itself_and_is_not_undone(tmp_path: Path) -> None:
    with Loop(tmp_path, guard=AUTO, control=LEARNING) as loop:
        teach(loop)
        wait_until_saved(loop)
        assert access.reset(loop.configuration.state_directory) is not None
        start_s = time.monotonic()
        loop.cycle_until("the stiction table was replaced: reset")
        assert time.monotonic() - start_s < 30.0
        loop.sample()  # the cycle is given it
        assert loop.session.state.table.sequence == 0
        teach(loop)
        wait_until_saved(loop)
    assert access.dump(tmp_path / "state").table == loop.session.state.table


def statuses(loop: Loop, count: int) -> list[PositionerStatus]:
    sent = [message for _ in range(5 * count) for message in loop.sample()]
    return [message for message in sent if isinstance(message, PositionerStatus)]


def test_a_full_disk_is_reported_once_and_shown_and_the_loop_goes_on(tmp_path: Path) -> None:
    with Loop(tmp_path, guard=AUTO, control=LEARNING) as loop:
        teach(loop)
        wait_until_saved(loop)
        writer = loop.session.table.writer._child.process.pid
        _, most = resource.prlimit(writer, resource.RLIMIT_FSIZE)
        resource.prlimit(writer, resource.RLIMIT_FSIZE, (512, most))
        teach(loop)
        loop.cycle_until("cannot be saved")
        teach(loop)
        shown = statuses(loop, 2)[-1]
        assert (shown.table_saved, shown.health) == (False, Health.MAINTENANCE_REQUIRED)
        assert len(loop.logged("cannot be saved")) == 1
        assert any(isinstance(message, CurrentCommand) for message in loop.sample())
        resource.prlimit(writer, resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, most))
        loop.cycle_until("saved again")
        wait_until_saved(loop)
        shown = statuses(loop, 2)[-1]
        assert (shown.table_saved, shown.health) == (True, Health.GOOD)


def test_a_state_directory_that_becomes_a_file_is_reported_once_and_ends_in_a_status(tmp_path: Path) -> None:
    state = tmp_path / "state"
    with Loop(tmp_path, guard=AUTO, control=LEARNING) as loop:
        teach(loop)
        wait_until_saved(loop)  # a rename in the middle of a commit is another error
        state.rename(tmp_path / "gone")
        state.write_text("not a directory", encoding="utf-8")
        teach(loop)
        loop.cycle_until("cannot be saved")
        teach(loop)
        assert len(loop.logged("cannot be saved")) == 1
        assert any(isinstance(message, CurrentCommand) for message in loop.sample())
        assert loop.close() is ExitCode.IO
        assert len(loop.logged("cannot be saved")) == 2
        state.unlink()
        (tmp_path / "gone").rename(state)


def test_a_table_writer_that_dies_is_replaced_and_nothing_is_lost(tmp_path: Path) -> None:
    with Loop(tmp_path, guard=AUTO, control=LEARNING) as loop:
        teach(loop)
        loop.session.table.writer._child.process.kill()
        teach(loop)
        loop.cycle_until("saved again")
        teach(loop)
        wait_until_saved(loop)
