"""The causes of alarms: their usual limits, their remedies, and their bits on the bus. Pure."""

from __future__ import annotations

from enum import IntEnum
from types import MappingProxyType
from typing import TYPE_CHECKING

from positioner.cycle.hunting import SWING_OF_SPAN
from positioner.values import dataclass
from positioner.wire.messages import Health

if TYPE_CHECKING:
    from collections.abc import Mapping


class AlarmCause(IntEnum):
    """What is wrong with the valve; the number is the bit in POSITIONER_ALARMS."""

    FRICTION_HIGH = 0
    FRICTION_LOW = 1
    SLIP_JUMP = 2
    SPRING_RATE = 3
    SPRING_FORCE = 4
    ONE_SIDED = 5
    END_POSITION = 6
    TRAVEL_DEVIATION = 7
    RESPONSE_TIME = 8
    CYCLES = 9
    TRAVEL = 10
    STROKE_TEST = 11
    STUCK = 12
    HUNTING = 13

    @property
    def key(self) -> str:
        """The name of its table in `[health]`."""
        return self.name.lower()


@dataclass(frozen=True, slots=True)
class Limits:
    """When a cause is an alarm.

    limit, serious_limit: of the value, 0 for none; category, serious_category: what the status then says.
    delay_s: for how long the value has been beyond its limit. clears_at: part of the limit below which it ends.
    """

    limit: float
    category: Health
    serious_limit: float
    serious_category: Health
    delay_s: float
    clears_at: float = 0.8


@dataclass(frozen=True, slots=True)
class CauseText:
    """What a person reads: what it is, the unit of its value and the factor to it, and what to do."""

    what: str
    unit: str
    factor: float
    remedy: str


_M, _S, _F = Health.MAINTENANCE_REQUIRED, Health.OUT_OF_SPECIFICATION, Health.FAILURE

LIMITS: Mapping[AlarmCause, Limits] = MappingProxyType(
    {
        AlarmCause.FRICTION_HIGH: Limits(0.20, _M, 0.40, _S, 1.0),
        AlarmCause.FRICTION_LOW: Limits(0.20, _M, 0.40, _S, 1.0),
        AlarmCause.SLIP_JUMP: Limits(0.02, _M, 0.04, _S, 1.0),
        AlarmCause.SPRING_RATE: Limits(0.05, _M, 0.10, _S, 1.0),
        AlarmCause.SPRING_FORCE: Limits(0.05, _M, 0.10, _S, 1.0),
        AlarmCause.ONE_SIDED: Limits(0.20, _M, 0.40, _S, 1.0),
        AlarmCause.END_POSITION: Limits(0.01, _M, 0.03, _S, 1.0),
        AlarmCause.TRAVEL_DEVIATION: Limits(0.05, _S, 0.0, _S, 10.0),
        AlarmCause.RESPONSE_TIME: Limits(1.5, _M, 2.0, _S, 0.0, 0.95),
        AlarmCause.CYCLES: Limits(0.9, _M, 0.0, _M, 0.0, 1.0),
        AlarmCause.TRAVEL: Limits(0.9, _M, 0.0, _M, 0.0, 1.0),
        AlarmCause.STROKE_TEST: Limits(1.0, _M, 2.0, _F, 0.0, 1.0),
        AlarmCause.STUCK: Limits(1.5, _F, 0.0, _F, 2.0),
        AlarmCause.HUNTING: Limits(SWING_OF_SPAN, _S, 0.0, _S, 0.0),
    }
)
"""Parts of the reference, of the span or of the count's own limit; of STROKE_TEST 1 is failed or overdue, 2 stuck."""

TEXTS: Mapping[AlarmCause, CauseText] = MappingProxyType(
    {
        AlarmCause.FRICTION_HIGH: CauseText(
            "friction has risen",
            "%",
            100.0,
            "look at the packing: too tight, dry, corroded or dirty; then `positioner signature`",
        ),
        AlarmCause.FRICTION_LOW: CauseText(
            "friction has fallen",
            "%",
            -100.0,
            "look at the packing: worn or loose; look for a leak to the air; then `positioner signature`",
        ),
        AlarmCause.SLIP_JUMP: CauseText(
            "the slip jump has grown",
            "% of span",
            100.0,
            "look at the packing's lubrication; then `positioner signature`",
        ),
        AlarmCause.SPRING_RATE: CauseText(
            "the spring rate has changed",
            "%",
            100.0,
            "look at the spring and at the calibration of current and position",
        ),
        AlarmCause.SPRING_FORCE: CauseText(
            "the spring's force has shifted",
            "% of bench range",
            100.0,
            "look at the I/P converter's zero, the air supply, the spring's preload and the process",
        ),
        AlarmCause.ONE_SIDED: CauseText(
            "one direction needs another force",
            "% of friction",
            100.0,
            "look at the air supply, for a leak, and at the I/P converter's range; it is not the packing",
        ),
        AlarmCause.END_POSITION: CauseText(
            "an end position has moved", "% of span", 100.0, "look at the seat, the stop and the sensor's zero"
        ),
        AlarmCause.TRAVEL_DEVIATION: CauseText(
            "the position stays away from the setpoint",
            "% of span",
            100.0,
            "look at the other alarms, the air supply, and the reach of the valve: `positioner reach`",
        ),
        AlarmCause.RESPONSE_TIME: CauseText(
            "the response has become slow",
            "times the reference",
            1.0,
            "look at the air supply, the tubing and the I/P converter; then `positioner step-test`",
        ),
        AlarmCause.CYCLES: CauseText("cycles", "% of their limit", 100.0, "plan the packing's replacement"),
        AlarmCause.TRAVEL: CauseText("travel", "% of its limit", 100.0, "plan the packing's replacement"),
        AlarmCause.STROKE_TEST: CauseText(
            "the stroke test", "", 1.0, "look at the kept result, or repeat it: `positioner stroke-test`"
        ),
        AlarmCause.STUCK: CauseText(
            "the stem does not move",
            "times its friction",
            1.0,
            "free the stem or remove the obstacle; the output cannot be trusted",
        ),
        AlarmCause.HUNTING: CauseText(
            "the stem hunts",
            "% of span",
            100.0,
            "look for less friction or more lag than configured, or a law tuned too fast; then `positioner identify`",
        ),
    }
)
