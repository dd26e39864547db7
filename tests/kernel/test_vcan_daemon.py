"""The daemon as a process on a virtual CAN interface: the tests of the embedded bus, and extended identifiers."""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING

import daemon_helpers
import pytest
from daemon_helpers import Service
from links import vcan
from test_daemon_process import (  # noqa: F401 - collected here as well
    USERS_DBC,
    USERS_WIRE,
    test_a_kill_loses_nothing_that_was_learned_and_a_reset_is_taken_over,
    test_a_service_commands_nothing_until_armed_and_saves_its_table_at_the_end,
    test_a_service_waits_for_a_bus_that_is_not_there_and_can_be_stopped_meanwhile,
    test_a_valve_that_speaks_frames_of_its_own_is_controlled,
    test_another_controller_on_the_bus_ends_a_daemon_before_it_sends_a_frame,
)
from test_vcan_bus import filters

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from positioner.bus.address import BusAddress

pytestmark = [pytest.mark.kernel("vcan"), pytest.mark.slow(short="runtime/test_daemon_process.py")]


@pytest.fixture(autouse=True)
def on_vcan(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Whoever asks for a bus of its own gets a virtual CAN interface."""
    with ExitStack() as links:

        def own_address() -> BusAddress:
            return links.enter_context(vcan())

        monkeypatch.setattr(daemon_helpers, "own_address", own_address)
        monkeypatch.setattr("test_daemon_process.own_address", own_address)
        yield


@pytest.mark.short_form
def test_a_daemon_asks_the_kernel_for_just_the_identifiers_of_its_dbc(tmp_path: Path) -> None:
    with Service(tmp_path) as own:
        # CURRENT_COMMAND (a foreign one), STEM_POSITION, ACTUATOR_STATE, SETPOINT, MANUAL_CURRENT; the test gets all
        assert filters(own.address.channel) == {
            "all",
            *(f"{i:03x} 800007ff" for i in (0x100, 0x110, 0x111, 0x120, 0x121)),
        }
        assert own.stop() == 0
    (tmp_path / "user").mkdir()
    (tmp_path / "user" / "users.dbc").write_text(USERS_DBC, encoding="utf-8")
    with Service(tmp_path / "user", wire=USERS_WIRE) as user:
        held = filters(user.address.channel)
        assert {f"{2566844927 | 1 << 31:08x} 9fffffff", f"{2566844926 | 1 << 31:08x} 9fffffff"} <= held
        assert {"111 800007ff", "120 800007ff"} <= held
        assert user.stop() == 0
