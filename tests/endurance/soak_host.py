"""The host of a soak: asks for setpoints, arms the positioner whenever it is not armed, measures the frames."""

from __future__ import annotations

import random
import time
from array import array
from collections import Counter
from typing import TYPE_CHECKING

from positioner.bus.port import BusPort
from positioner.wire.codec import make_codec
from positioner.wire.e2e import COUNTER_MODULUS
from positioner.wire.formats import FrameRejectedError
from positioner.wire.messages import (
    Cause,
    CurrentCommand,
    HostRequest,
    Mode,
    PlantTruth,
    PositionerStatus,
    Setpoint,
    StemPosition,
)

if TYPE_CHECKING:
    from positioner.bus.address import BusAddress

_SETPOINT_EVERY_S = 0.05
_DWELL_S = 1.5
_LOW_M, _HIGH_M = 0.068, 0.092
_SILENCE_S = 0.5
"""Without a command for so long the last mode received is no longer current."""
_NEVER_TRUE = frozenset(
    {Cause.FEEDBACK_FROZEN, Cause.FEEDBACK_DISPUTED, Cause.SETPOINT_DISPUTED, Cause.SETPOINT_UNREACHABLE}
)
"""Causes that no status of this soak may report: there is one noisy sensor, and one host with ordinary setpoints."""
_LARGE_M = 0.04 * 0.127
_LASTS_S = 1.0
"""A deviation is true where the stem has been so far away for so long, according to the emulator."""
_NS = 1_000_000_000


class SoakHost:
    """Plays the setpoints; `periods_s` and `latencies_s` are those of the commands, `modes` counts the entries by mode.

    false_alarms: untrue statuses, by cause.
    """

    def __init__(self, address: BusAddress, seed: int) -> None:
        self._bus = BusPort(address)
        self._bus.open()
        self._codec = make_codec()
        self._chance = random.Random(seed)  # noqa: S311 - no secret
        self._sent = 0
        self._setpoint_m = _HIGH_M
        self._setpoint_due_s = self._dwell_due_s = 0.0
        self._positions: dict[int, int] = {}
        self._command_ns: int | None = None
        self._mode: Mode | None = None
        self.periods_s = array("d")
        self.latencies_s = array("d")
        self.modes: dict[Mode, int] = {}
        self.unsaved = 0
        self.false_alarms: Counter[Cause] = Counter()
        self._near_s = time.monotonic()

    @property
    def is_controlled(self) -> bool:
        """Whether the valve is under control right now."""
        return self._mode is Mode.ACTIVE

    @property
    def has_failed_safe(self) -> bool:
        """Whether the positioner is in FAILSAFE right now."""
        return self._mode is Mode.FAILSAFE

    def step(self, timeout_s: float) -> None:
        """Send what is due, and receive for up to `timeout_s`."""
        now_s = time.monotonic()
        if now_s >= self._setpoint_due_s:
            self._setpoint_due_s = now_s + _SETPOINT_EVERY_S
            self._ask(now_s)
        for frame in self._bus.receive(timeout_s):
            try:
                message, counter = self._codec.decode(frame)
            except FrameRejectedError:
                continue
            if isinstance(message, StemPosition) and counter is not None:
                self._positions[counter] = frame.received_ns
            elif isinstance(message, CurrentCommand):
                self._add(message, frame.received_ns)
            elif isinstance(message, PositionerStatus):
                self._enter(message.mode)
                self.unsaved += not message.table_saved
                untrue = message.cause is Cause.DEVIATION and now_s - self._near_s < _LASTS_S
                self.false_alarms[message.cause] += message.cause in _NEVER_TRUE or untrue
            elif isinstance(message, PlantTruth) and self._is_near(message.position_m, now_s):
                self._near_s = now_s
        if self._command_ns is not None and time.monotonic_ns() - self._command_ns > _SILENCE_S * _NS:
            self._command_ns = None
            self._mode = None

    def forget(self) -> None:
        """Drop the frames that wait, and the last mode."""
        while self._bus.receive(0.0):
            pass
        self._positions.clear()
        self._command_ns = None
        self._mode = None

    def close(self) -> None:
        """Close the bus."""
        self._bus.close()

    def _is_near(self, position_m: float, now_s: float) -> bool:
        """Return whether the stem is near a setpoint that a positioner has had the time to receive."""
        is_known = now_s - (self._dwell_due_s - _DWELL_S) > _SILENCE_S
        return is_known and abs(position_m - self._setpoint_m) < _LARGE_M

    def _ask(self, now_s: float) -> None:
        if now_s >= self._dwell_due_s:
            self._dwell_due_s = now_s + _DWELL_S
            self._setpoint_m = self._chance.uniform(_LOW_M, _HIGH_M)
        ask = not self.is_controlled and self._sent % 2 == 1  # a request counts when it changes
        request = HostRequest.ARM if ask else HostRequest.NONE
        self._bus.send(self._codec.encode(Setpoint(self._setpoint_m, request), self._sent % COUNTER_MODULUS))
        self._sent += 1

    def _add(self, command: CurrentCommand, received_ns: int) -> None:
        if self._command_ns is not None:
            self.periods_s.append((received_ns - self._command_ns) / _NS)
        self._command_ns = received_ns
        if command.position_counter is not None:
            asked_ns = self._positions.pop(command.position_counter, None)
            if asked_ns is not None:
                self.latencies_s.append((received_ns - asked_ns) / _NS)
        self._enter(command.mode)

    def _enter(self, mode: Mode) -> None:
        if mode is not self._mode:
            self._mode = mode
            self.modes[mode] = self.modes.get(mode, 0) + 1
