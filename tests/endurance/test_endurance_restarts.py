"""The short form of `make restart-test`, and proof that it would find what it looks for."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from endurance import restarts
from positioner.guard.arming import _latest_request
from positioner.runtime.other_controller import OtherController
from positioner.wire.messages import HostRequest

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.bus
HELD = restarts.Case("feedback lost", "kill", HostRequest.ARM, (0, 0.0))
QUEUED = restarts.Case("none", "kill", HostRequest.NONE, (128, 0.0))


def test_no_restart_arms_without_a_request_and_no_unit_stays_down(tmp_path: Path) -> None:
    every = list(restarts.cases())
    assert len(every) * restarts.ROUNDS >= 1000
    wrong, _ = restarts.play(tmp_path, every[:: len(every) // 21], seed=7)
    assert wrong == {}


def test_a_start_that_takes_a_held_request_for_a_new_one_is_seen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def eager(before: HostRequest | None, requests: list[HostRequest], *, fresh: bool) -> object:
        return _latest_request(HostRequest.NONE if before is None else before, requests, fresh=fresh)

    monkeypatch.setattr("positioner.guard.arming._latest_request", eager)
    wrong, _ = restarts.play(tmp_path, [HELD], seed=7)
    assert "commands that nobody has asked for" in wrong[HELD]


def test_a_start_that_takes_the_last_commands_of_the_daemon_before_for_another_controller_is_seen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(OtherController, "goes_on", lambda _self, _now_ns: True)
    wrong, _ = restarts.play(tmp_path, [QUEUED], seed=7)
    assert wrong[QUEUED].startswith("a person is needed: status 69: not started: another controller")
