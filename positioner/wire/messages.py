"""The messages on the bus, as typed values. Pure.

They are in SI units, but for the loop current in mA; the DBC scales them to mm, kPa and mA in the frame. A counter echo
is the 8-bit counter of the frame that the sender last accepted from the other side, None where a foreign DBC has no
signal for it.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Self

from positioner.values import dataclass


@dataclass(frozen=True, slots=True)
class CanFrame:
    """One classic CAN frame, as read from or written to a bus; `received_ns` is monotonic, 0 when not received."""

    arbitration_id: int
    data: bytes
    is_extended: bool = False
    is_error: bool = False
    is_remote: bool = False
    received_ns: int = 0

    @property
    def identifier(self) -> tuple[int, bool]:
        """The identifier, and whether it is extended."""
        return self.arbitration_id, self.is_extended


class Mode(IntEnum):
    """Modes of the positioner's guard."""

    INIT = 0
    READY = 1
    ACTIVE = 2
    HOLD = 3
    FAILSAFE = 4
    MANUAL = 5


class Motion(IntEnum):
    """What the control law does with the stem."""

    NONE = 0
    REST = 1  # HOLD in the DBC; not the mode HOLD
    MOVE = 2
    SETTLE = 3


class Quality(IntEnum):
    """Quality of a position reading, by the plant's node; where several apply, the highest.

    FAIL_POSITION: the reading is valid, but no command acts on the valve: the node has received none since its start,
    or none for too long, or the last one is a failure signal. The command counter then names no acting command.
    """

    VALID = 0
    SUSPECT = 1
    FAULT = 2
    FAIL_POSITION = 3


class HostRequest(IntEnum):
    """What the host asks for besides the setpoint."""

    NONE = 0
    ARM = 1
    DISARM = 2


class ManualRequest(IntEnum):
    """Who gives the current: the law, or a person at the host."""

    AUTO = 0
    MANUAL = 1


class Health(IntEnum):
    """NAMUR NE 107 status signals."""

    GOOD = 0
    MAINTENANCE_REQUIRED = 1
    OUT_OF_SPECIFICATION = 2
    FUNCTION_CHECK = 3
    FAILURE = 4


class Cause(IntEnum):
    """Why the positioner is in its mode, or what is wrong."""

    NONE = 0
    WAITING_FOR_FEEDBACK = 1
    WAITING_FOR_ARM = 2
    FEEDBACK_STALE = 3
    FEEDBACK_IMPLAUSIBLE = 4
    SETPOINT_STALE = 5
    FOREIGN_COMMAND = 6
    LAW_FAILED = 7
    DISARMED = 10
    FEEDBACK_FROZEN = 12
    LAW_LATE = 13
    DEVIATION = 14
    SETPOINT_UNREACHABLE = 15
    STALLED = 16
    FEEDBACK_DISPUTED = 17
    SETPOINT_DISPUTED = 18
    ACTUATOR_FAILED = 19
    COMMAND_IGNORED = 20
    MANUAL = 21
    PERIOD_WRONG = 22
    VALVE_DIFFERS = 23
    HUNTING = 24
    NO_MOTION = 25


class Counted(IntEnum):
    """The causes that are counted: number in the DBC, text in the log. A new one needs a member here and in the DBC."""

    WRONG_LENGTH = 1, "wrong length"
    WRONG_CRC = 2, "wrong CRC"
    OUT_OF_RANGE = 3, "value out of range"
    UNDEFINED_VALUE = 4, "undefined value"
    REPEATED = 5, "repeated counter"
    OUT_OF_ORDER = 6, "counter out of order"
    ERROR_FRAME = 7, "error frame"
    REMOTE_FRAME = 8, "remote frame"
    LOST = 9, "frame lost"
    FEEDBACK_FAULT = 10, "sensor fault"
    FEEDBACK_RANGE = 11, "reading outside the travel"
    FEEDBACK_JUMP = 12, "reading jumped"
    FEEDBACK_FROZEN = 13, "reading frozen"
    SETPOINT_REFUSED = 14, "setpoint outside the travel"
    FOREIGN_COMMAND = 15, "command of another controller"
    LAW_LATE = 16, "late cycle"
    STALLED = 17, "stall"
    PUSH_FAILED = 18, "push without breakaway"
    LINE_DROPPED = 19, "line of the log dropped"
    DISPUTED = 20, "two senders under one identifier"

    text: str

    def __new__(cls, number: int, text: str) -> Self:
        """Make the member of that number."""
        member = int.__new__(cls, number)
        member._value_ = number
        member.text = text
        return member


@dataclass(frozen=True, slots=True)
class StemPosition:
    """STEM_POSITION, plant → positioner: the measured stem position x."""

    position_m: float
    command_counter: int | None = None
    quality: Quality = Quality.VALID


@dataclass(frozen=True, slots=True)
class ActuatorState:
    """ACTUATOR_STATE, plant → positioner, optional: the measured actuator pressure P."""

    pressure_pa: float


@dataclass(frozen=True, slots=True)
class Setpoint:
    """SETPOINT, host → positioner: the wanted stem position r, and a request."""

    setpoint_m: float
    request: HostRequest = HostRequest.NONE


@dataclass(frozen=True, slots=True)
class ManualCurrent:
    """MANUAL_CURRENT, host → positioner: the loop current that a person asks for, repeated while manual mode lasts."""

    current_ma: float
    request: ManualRequest = ManualRequest.MANUAL


@dataclass(frozen=True, slots=True)
class CurrentCommand:
    """CURRENT_COMMAND, positioner → plant: the loop current u."""

    current_ma: float
    position_counter: int | None = None
    setpoint_counter: int | None = None
    mode: Mode = Mode.ACTIVE
    motion: Motion = Motion.NONE


@dataclass(frozen=True, slots=True)
class PositionerStatus:
    """POSITIONER_STATUS, positioner → host, 10 Hz; the three counts wrap at 256."""

    mode: Mode
    cause: Cause
    health: Health
    armed: bool
    table_saved: bool
    fallback_count: int
    rejected_count: int
    learned_count: int


@dataclass(frozen=True, slots=True)
class PositionerCount:
    """POSITIONER_COUNT, positioner → host, after a status: the count of one cause; the causes take turns."""

    counted: Counted
    count: int


@dataclass(frozen=True, slots=True)
class PositionerAlarms:
    """POSITIONER_ALARMS, positioner → host, after a status: the alarms of the valve's condition.

    worst: the worst category of the active ones, and how many they are (15 for more); active, unacknowledged: a bit for
    each cause.
    """

    worst: Health
    count: int
    active: int
    unacknowledged: int


@dataclass(frozen=True, slots=True)
class PlantTruth:
    """PLANT_TRUTH, emulator only: the true stem position and speed, without noise."""

    position_m: float
    velocity_m_per_s: float


Message = (
    StemPosition
    | ActuatorState
    | Setpoint
    | ManualCurrent
    | CurrentCommand
    | PositionerStatus
    | PositionerCount
    | PositionerAlarms
    | PlantTruth
)
