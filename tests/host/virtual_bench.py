"""The host with the positioner and the emulated valve, in virtual time."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from plant_emulator.device import advance, initial_device, publish, take
from plant_emulator.presets import plant_settings
from positioner.config.reader import parse_config
from positioner.cycle.input import CycleInput
from positioner.cycle.state import CycleState, Setup
from positioner.cycle.step import step
from positioner.host.session import HostSession
from positioner.host.verbs import read_verbs
from positioner.wire.messages import CurrentCommand, ManualCurrent, Mode, Setpoint

if TYPE_CHECKING:
    from positioner.config.schema import Configuration
    from positioner.wire.messages import CanFrame, Message

MS = 1_000_000
PERIOD_NS = 2 * MS
TEXT = '[valve]\nid = "V"\npreset = "paper"\n[control]\nsample_period_s = 0.002\n'


class Bench:
    """One host, one positioner, one valve; every cycle is a period, and the host runs in each."""

    def __init__(self, text: str = TEXT) -> None:
        self.configuration = self.configuration_of(text)
        self.codec = self.configuration.make_codec()
        control = self.configuration.control
        law = self.configuration.make_law()
        self.setup = Setup(self.codec, self.configuration.valve, self.configuration.guard, law, control.sample_period_s)
        self.plant = plant_settings("paper")
        self.device = initial_device(self.plant, 3)
        self.state = CycleState()
        self.session = HostSession(self.configuration)
        self.now_ns = 1000 * MS
        self.sent: list[Message] = []
        self.currents: list[float] = []
        self.plant_is_on = self.positioner_is_on = self.host_is_on = True
        self.others: list[CanFrame] = []
        self.second: HostSession | None = None
        self.cycles = self.foreign_every = 0
        self.run(0.7)

    @staticmethod
    def configuration_of(text: str) -> Configuration:
        return parse_config(text, "test", Path())

    def run(self, duration_s: float) -> None:
        for _ in range(round(duration_s * 1e9 / PERIOD_NS)):
            self.now_ns += PERIOD_NS
            bus = [*self.others]
            self.others = []
            self.cycles += 1
            if self.foreign_every and self.cycles % self.foreign_every == 0:
                bus.append(self.codec.encode(CurrentCommand(9.5), self.cycles // self.foreign_every))
            if self.host_is_on:
                frames = self.session.advance(self.now_ns)
                self.sent += [self.codec.decode(frame)[0] for frame in frames]
                bus += frames
            from_second = () if self.second is None else self.second.advance(self.now_ns)
            if self.second is not None:
                bus += from_second
            if self.plant_is_on:
                self.device, frames = publish(self.codec, self.plant, self.device)
                bus += frames
            outbox: tuple[CanFrame, ...] = ()
            if self.positioner_is_on:
                self.state, outbox, _ = step(self.setup, self.state, CycleInput(tuple(bus), self.now_ns))
            own = {self.codec.identifier(Setpoint), self.codec.identifier(ManualCurrent)} if self.host_is_on else set()
            received = [frame for frame in bus if frame.identifier not in own]
            self.session.receive([*received, *from_second, *outbox], self.now_ns)
            if self.second is not None:
                self.second.receive([frame for frame in [*bus, *outbox] if frame not in from_second], self.now_ns)
            self.currents += [
                message.current_ma
                for message, _ in map(self.codec.decode, outbox)
                if isinstance(message, CurrentCommand)
            ]
            self.device = advance(self.plant, take(self.codec, self.device, outbox), PERIOD_NS / 1e9)

    def say(self, text: str, *, within_s: float = 1.0) -> None:
        """Begin the verbs in `text`, each when the one before is done."""
        for verb in read_verbs([text], self.configuration.valve, self.configuration.guard):
            self.session.begin(verb, self.now_ns)
            self.until_done(within_s)

    def until_done(self, within_s: float) -> None:
        end_ns = self.now_ns + round(within_s * 1e9)
        while self.session.is_busy:
            assert self.now_ns < end_ns, self.session.lines
            self.run(PERIOD_NS / 1e9)

    def is_in(self, mode: Mode) -> bool:
        return self.state.guard.mode is mode

    @property
    def true_m(self) -> float:
        return self.device.plant.stem.position_m

    def reported(self, word: str) -> list[str]:
        return [line for line in self.session.lines if word in line]
