"""A second daemon on this bus, with a state directory of its own, armed by the same ARM. Pure.

Two daemons of the same configuration send the same frames at first. A bus that doubles frames brings our own commands
back, so a command like one of ours does not count as foreign. But a bus doubles only some frames, and a second daemon
sends one for each of ours.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.cycle.events import ForeignCommand
from positioner.values import dataclass, replace
from positioner.wire.messages import CurrentCommand

if TYPE_CHECKING:
    from positioner.cycle.link import Received
    from positioner.cycle.sent import OutputState, SentCommands
    from positioner.wire.codec import Codec

_DOUBLED_SHARE = 0.75
"""A bus that doubles frames doubles a smaller share of them."""
_EXCESS = 12.0
"""So many more than that share are a second daemon: 45 of 45, or one false alarm in 10^12 cycles on a bus that doubles
every second frame."""


@dataclass(frozen=True, slots=True)
class ReturnedCommands:
    """Commands like ours that came back. excess: how many more than a bus doubles; sent: how many we had sent then."""

    excess: float = 0.0
    sent: int = 0


NO_RETURNED_COMMANDS = ReturnedCommands()


def without_own_commands(
    codec: Codec, received: Received, output: OutputState, before: ReturnedCommands
) -> tuple[Received, ReturnedCommands]:
    """Return what was received without the commands like ours, and the record of these.

    They are kept where so many come back that only a second daemon can have sent them.
    """
    fading = _DOUBLED_SHARE * (output.command_counter - before.sent)
    excess = 0.0 if output.sent.last is None else max(before.excess - fading, 0.0)
    if received.guard_input.foreign_command:
        modulus = codec.by_kind[CurrentCommand].counter_modulus
        step_ma = codec.field(CurrentCommand, "current_ma").si_per_bit
        commands = [event for event in received.events if isinstance(event, ForeignCommand)]
        ours = [event for event in commands if _is_like_ours(event, output.sent, modulus, step_ma)]
        excess += len(ours)
        removed = ours if excess < _EXCESS else []
        guard_input = replace(
            received.guard_input, foreign_command=len(removed) < len(commands), own_command_returned=bool(ours)
        )
        events = tuple(event for event in received.events if event not in removed)
        received = replace(received, guard_input=guard_input, events=events)
    return received, ReturnedCommands(excess, output.command_counter)


def _is_like_ours(event: ForeignCommand, sent: SentCommands, modulus: int, step_ma: float) -> bool:
    """Return whether the command is like one that we sent; `step_ma` is the resolution of its signal in mA."""
    ours = None if event.counter is None else sent.named(event.counter, modulus)
    return ours is not None and math.isclose(ours.current_ma, event.current_ma, abs_tol=step_ma)
