"""The virtual world in which the readings are those of an emulated valve that obeys the commands."""

from __future__ import annotations

from typing import Any

from virtual_shell import World

from plant_emulator.device import advance, initial_device, publish, take
from plant_emulator.presets import plant_settings
from positioner.wire.messages import CanFrame


class PlantWorld(World):
    """A world whose plant moves with its commands."""

    settings = plant_settings("paper", {"valve": {"initial_position_m": 0.075}, "sensor": {"noise_of_reading": 0.0002}})
    device = initial_device(settings, 1)

    def send(self, message: Any, timeout: float | None = None) -> None:
        super().send(message, timeout)
        frame = CanFrame(message.arbitration_id, bytes(message.data))
        self.device = take(self.codec, self.device, (frame,))

    def _live_until(self, end_ns: int) -> None:
        while self._next_ns <= end_ns:
            self.now_ns = self._next_ns
            self.device = advance(self.settings, self.device, self.period_ns / 1e9)
            self.device, frames = publish(self.codec, self.settings, self.device)
            if not self.plant_silent:
                reading, counter = self.codec.decode(frames[-1])
                self._deliver(reading, counter)
            self.sample += 1
        self.now_ns = end_ns
