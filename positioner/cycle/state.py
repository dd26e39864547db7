"""What a cycle starts from: what never changes, and what it carries on. Pure."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from positioner.cycle.command_effect import EFFECT_UNKNOWN, CommandEffect, SentCommand
from positioner.cycle.counters import Counters
from positioner.cycle.deviation import NO_DEVIATION, Deviation
from positioner.cycle.link import LinkState
from positioner.cycle.second_daemon import NO_RETURNED_COMMANDS, ReturnedCommands
from positioner.guard.state import GuardState
from positioner.valve.stiction import StictionTable

if TYPE_CHECKING:
    from positioner.cycle.handover import Handover
    from positioner.guard.settings import GuardSettings
    from positioner.laws.law import Law
    from positioner.valve.credible import Limits
    from positioner.valve.parameters import ValveParameters
    from positioner.valve.state import StemState
    from positioner.wire.codec import Codec


@dataclass(frozen=True, slots=True)
class Setup:
    """What never changes while a positioner runs. `learns` is off where commands never reach the valve (dry run).

    limits: what is credible of a table, None for that of the valve within the usual range of spring and friction.
    """

    codec: Codec
    valve: ValveParameters
    guard: GuardSettings
    law: Law[Any]
    period_s: float
    learns: bool = True
    limits: Limits | None = None


@dataclass(frozen=True, slots=True)
class CycleState:
    """Everything a positioner carries on.

    `memory` is the law's own.
    believed: the table as this cycle left it; another one comes from outside, and is looked through first.
    """

    table: StictionTable = field(default_factory=StictionTable)
    believed: StictionTable | None = None
    guard: GuardState = field(default_factory=GuardState)
    link: LinkState = field(default_factory=LinkState)
    memory: Any = None
    stem: StemState | None = None
    sent: tuple[SentCommand, ...] = ()
    returned: ReturnedCommands = NO_RETURNED_COMMANDS
    effect: CommandEffect = EFFECT_UNKNOWN
    command_counter: int = 0
    command_ns: int = 0
    status_counter: int = 0
    status_ns: int | None = None
    control_s: float = 0.0
    setpoint_m: float = 0.0
    table_saved: bool = True
    answered: bool = False
    left_ma: float | None = None
    counters: Counters = field(default_factory=Counters)
    handover: Handover | None = None
    deviation: Deviation = NO_DEVIATION

    @property
    def last_ma(self) -> float | None:
        """The current commanded last, None before the first."""
        return self.sent[-1].current_ma if self.sent else None
