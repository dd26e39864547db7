"""Before the first cycle of a valve everything was used once, by a positioner that is connected to nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from daemon_helpers import own_address, write_configuration

from positioner.config.reader import load_config
from positioner.cycle.events import Controlled
from positioner.cycle.step import step
from positioner.laws.registry import LAWS
from positioner.runtime import warm_up as module
from positioner.runtime.warm_up import warm_up
from positioner.wire.messages import Mode, Motion

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize("law", LAWS)
def test_every_law_has_controlled_and_nmpc_has_moved_the_stem(
    law: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cycles: list[Controlled] = []

    def watched(setup: object, state: object, cycle_input: object) -> tuple[object, object, object]:
        state, outbox, events = step(setup, state, cycle_input)  # type: ignore[arg-type]
        cycles.extend(event for event in events if isinstance(event, Controlled))
        return state, outbox, events

    monkeypatch.setattr(module, "step", watched)
    warm_up(load_config(write_configuration(tmp_path, own_address(), control={"law": law, "sample_period_s": 0.001})))
    assert {cycle.mode for cycle in cycles} == {Mode.ACTIVE}
    assert len(cycles) >= 50
    if law == "nmpc":
        assert Motion.MOVE in {cycle.decision.motion for cycle in cycles}
