"""What a cycle starts from: what never changes, and what it carries on. Pure."""

from __future__ import annotations

from dataclasses import field
from typing import TYPE_CHECKING, Any

from positioner.cycle.command_effect import EFFECT_UNKNOWN, CommandEffect
from positioner.cycle.counters import Counters
from positioner.cycle.deviation import NO_DEVIATION, Deviation
from positioner.cycle.link import LinkState
from positioner.cycle.second_daemon import NO_RETURNED_COMMANDS, ReturnedCommands
from positioner.cycle.sent import OutputState
from positioner.cycle.vain_pushes import NO_PUSHES, VainPushes
from positioner.guard.state import GuardState
from positioner.setpoint.path import NEW_PATH, SetpointPath
from positioner.values import dataclass
from positioner.valve.stiction import StictionTable

if TYPE_CHECKING:
    from positioner.cycle.handover import Handover
    from positioner.cycle.hunting import Hunting
    from positioner.guard.settings import GuardSettings
    from positioner.laws.law import Law
    from positioner.setpoint.settings import SetpointSettings
    from positioner.valve.parameters import ValveParameters
    from positioner.valve.state import StemState
    from positioner.wire.codec import Codec


@dataclass(frozen=True, slots=True)
class Setup:
    """What never changes while a positioner runs. `learns` is off where commands never reach the valve (dry run).

    testing: the law is a test procedure.
    setpoint: the setpoint functions, None where none is on.
    """

    codec: Codec
    valve: ValveParameters
    guard: GuardSettings
    law: Law[Any]
    period_s: float
    learns: bool = True
    testing: bool = False
    setpoint: SetpointSettings | None = None


@dataclass(frozen=True, slots=True)
class ControlState:
    """What the closed loop carries on.

    memory: the law's own, None while it does not control; stem: its last estimate; setpoint_m: its last setpoint.
    time_s: for how long it has controlled since the start. path: of the setpoint, through its functions.
    """

    memory: Any = None
    stem: StemState | None = None
    setpoint_m: float = 0.0
    time_s: float = 0.0
    path: SetpointPath = NEW_PATH


@dataclass(slots=True)
class CycleState:
    """Everything a positioner carries on. `step` changes its own copy; no other function changes one.

    credible_table: the last table that was checked; another `table` comes from outside, and is checked before its use.
    alarms: of the valve's condition; alarmed: there was one since the start.
    hunting: the swings of the stem, None while no law controls it; vain: the pushes that moved nothing.
    answered: the law answered in the last cycle. differs: the law says that the valve does not move as configured.
    """

    table: StictionTable = field(default_factory=StictionTable)
    credible_table: StictionTable | None = None
    table_saved: bool = True
    alarms: int = 0
    alarmed: bool = False
    link: LinkState = field(default_factory=LinkState)
    returned: ReturnedCommands = NO_RETURNED_COMMANDS
    effect: CommandEffect = EFFECT_UNKNOWN
    deviation: Deviation = NO_DEVIATION
    hunting: Hunting | None = None
    vain: VainPushes = NO_PUSHES
    guard: GuardState = field(default_factory=GuardState)
    handover: Handover | None = None
    control: ControlState = field(default_factory=ControlState)
    answered: bool = False
    differs: bool = False
    output: OutputState = field(default_factory=OutputState)
    counters: Counters = field(default_factory=Counters)
