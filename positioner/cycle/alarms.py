"""The alarms of the valve's condition as one number, which a cycle is given and the record holds. Pure."""

from __future__ import annotations

from positioner.wire.messages import Health, PositionerAlarms

_BITS, _MASK, _MOST = 16, 0xFFFF, 15


def packed(worst: Health, active: int, unacknowledged: int) -> int:
    """Return the number of the worst category, and of the causes that are active, and that nobody has acknowledged."""
    return (worst << _BITS | unacknowledged) << _BITS | active


def worst_of(alarms: int) -> Health:
    """Return the worst category in a packed number."""
    return Health(alarms >> 2 * _BITS & 0xF)


def message_of(alarms: int) -> PositionerAlarms:
    """Return the message that tells a packed number."""
    active = alarms & _MASK
    return PositionerAlarms(worst_of(alarms), min(active.bit_count(), _MOST), active, alarms >> _BITS & _MASK)
