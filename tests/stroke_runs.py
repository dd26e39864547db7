"""Stroke tests on emulated valves: `cycle.step` and the emulated device exchange frames in memory."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tomli_w

from plant_emulator.device import advance, initial_device, publish, take
from positioner.cli.stroke_test import stroke_test_of
from positioner.commissioning.procedure import aborted_by, commissioning_setup, ended_by
from positioner.commissioning.stroke.result import stroke_result
from positioner.config.reader import parse_config
from positioner.cycle.input import CycleInput
from positioner.cycle.state import CycleState
from positioner.cycle.step import step
from positioner.values import replace
from positioner.wire.messages import CurrentCommand

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from plant_emulator.parameters import PlantSettings
    from positioner.commissioning.stroke.memory import StrokeMemory
    from positioner.commissioning.stroke.result import StrokeResult
    from positioner.config.schema import Configuration
    from positioner.wire.messages import Message

_NS = 1_000_000_000
_LONGEST_S = 300.0


@dataclass
class Played:
    """A stroke test at its end. The lists have one entry for each period.

    stem_m: the true position; sent_ma: the command, None where none was sent. stopped: the first period in which the
    test had been ended before its time.
    """

    memory: StrokeMemory | None = None
    result: StrokeResult | None = None
    ended_by: str = ""
    stem_m: list[float] = field(default_factory=list)
    sent_ma: list[float | None] = field(default_factory=list)
    stopped: int | None = None


def configured(valve: dict[str, Any] | None = None, period_s: float = 0.01, **tables: Any) -> Configuration:
    """Return the configuration of a valve, the paper's if nothing else is said."""
    tables = {"control": {"sample_period_s": period_s}, "guard": {"frozen_s": 0.0}, **tables}
    text = tomli_w.dumps({"valve": {"id": "FV-101", "preset": "paper", **(valve or {})}, **tables})
    return parse_config(text, "test", Path())


def play(
    configuration: Configuration,
    plant: PlantSettings,
    seed: int = 1,
    host: Callable[[int], Sequence[Message]] = lambda _: (),
    hears: Callable[[int], bool] = lambda _: True,
    after: Callable[[int], bool] = lambda _: False,
) -> Played:
    """Return the test of the valve `plant`.

    host: what the host sends before each period; hears: whether the positioner receives the reading of a period.
    after: whether a person stops the test after a period.
    """
    period_s, procedure = configuration.control.sample_period_s, stroke_test_of(configuration)
    setup = commissioning_setup(configuration.make_setup(), procedure)
    codec, state, device = setup.codec, CycleState(), initial_device(plant, seed)
    played, sent = Played(), 0
    for number in range(round(_LONGEST_S / period_s)):
        device, published = publish(codec, plant, device)
        frames = []
        for message in host(number):
            frames.append(codec.encode(message, sent))
            sent += 1
        inbox = (*frames, *published) if hears(number) else tuple(frames)
        state, outbox, _ = step(setup, state, CycleInput(inbox, round((number + 1) * period_s * _NS)))
        device = advance(plant, take(codec, device, outbox), period_s)
        played.stem_m.append(device.plant.stem.position_m)
        messages = [codec.decode(frame)[0] for frame in outbox]
        currents = [each.current_ma for each in messages if isinstance(each, CurrentCommand)]
        played.sent_ma.append(currents[-1] if currents else None)
        memory, mode, cause = state.control.memory, state.guard.mode, state.guard.cause
        played.memory = memory or played.memory
        if played.memory is None:
            continue
        played.ended_by = ended_by(mode, cause)
        why = "" if played.ended_by else aborted_by(mode, cause) or ("stopped by a person" if after(number) else "")
        if why:
            played.memory = procedure.abort(memory, why)
            state = replace(state, control=replace(state.control, memory=played.memory))
        over = bool(played.ended_by) or procedure.progress(played.memory).ended
        if played.stopped is None and (played.ended_by or played.memory.stop):
            played.stopped = number
        if over:
            break
    assert played.memory is not None
    valve, settings = configuration.valve, configuration.stroke_test
    played.result = stroke_result(played.memory, played.ended_by, valve, settings, period_s)
    return played
