"""A million hostile frames for the positioner and for the emulated valve: none is accepted that should not be.

Start it as `python -m endurance.fuzz`; `make fuzz` does.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from tqdm import tqdm

from endurance.attacks import ATTACKS, DAMAGING, TRUE, UNRECEIVED, Adversary
from endurance.oracle import KINDS, STRAY, Ledger, disarms, verdict_of
from plant_emulator.device import initial_device, take
from plant_emulator.presets import plant_settings
from positioner.cycle.counters import Counters
from positioner.cycle.events import (
    FeedbackRefused,
    ForeignCommand,
    FrameRefused,
    FramesLost,
    OrderDisputed,
    SetpointRefused,
)
from positioner.cycle.inbox import receive
from positioner.cycle.link import LinkState, Received
from positioner.guard.settings import GuardSettings
from positioner.valve.parameters import ValveParameters
from positioner.wire.codec import make_codec

if TYPE_CHECKING:
    from plant_emulator.device import DeviceState
    from positioner.wire.messages import CanFrame

COMMAND, POSITION, PRESSURE, SETPOINT, MANUAL = 0x100, 0x110, 0x111, 0x120, 0x121
COUNTED_BY_POSITIONER = frozenset({POSITION, PRESSURE, SETPOINT, MANUAL})
IGNORED = "unknown identifier"


class DisagreementError(AssertionError):
    """A receiver and the oracle disagree."""


@dataclass
class Findings:
    """The findings of a run: frames by attack, verdicts by cause, and frames that were valid by accident."""

    frames: int = 0
    attacks: Counter[str] = field(default_factory=Counter)
    verdicts: Counter[str] = field(default_factory=Counter)
    accidents: int = 0
    counters: Counters = field(default_factory=Counters)

    def lines(self) -> list[str]:
        """Return the findings for the reader."""
        hostile = self.frames - self.attacks[TRUE]
        return [
            f"{self.frames} frames, {hostile} of them not as a true sender sends them; none taken that should not be,",
            f"none refused that should not be; {self.accidents} damaged or random ones were valid by accident",
            "attacks: " + ", ".join(f"{name} {count}" for name, count in sorted(self.attacks.items())),
            "verdicts: " + ", ".join(f"{name} {count}" for name, count in sorted(self.verdicts.items())),
            "counted by the positioner: "
            + ", ".join(f"{kind.name} {count}" for kind, count in sorted(self.counters.by_cause.items())),
        ]


class Positioner:
    """The positioner's inbox, one frame at a time."""

    def __init__(self) -> None:
        self.codec, self.guard, self.valve = make_codec(), GuardSettings(max_jump_m=2.0), ValveParameters(id="fuzz")
        self.link, self.ledger, self.counters = LinkState(), Ledger(), Counters()
        self.lost = 0

    def receive(self, frame: CanFrame) -> str:
        """Give the frame to the positioner and to the oracle; return their verdict.

        Raises:
            DisagreementError: they differ, in verdict or in value.
        """
        expected = verdict_of(frame)
        if expected == "good" and frame.arbitration_id in COUNTED_BY_POSITIONER:
            expected = self.ledger.enter(frame.arbitration_id, frame.data)
        received = receive(self.codec, self.guard, self.valve, self.link, (frame,))
        refused = [event.counted.text for event in received.events if isinstance(event, FrameRefused)]
        verdict = refused[0] if refused else STRAY if expected == STRAY else "good"
        if verdict != expected and not (expected == IGNORED and not received.events):
            raise DisagreementError(f"the positioner says '{verdict}', the oracle '{expected}'")
        counters = self.counters.add(received.events)
        if (counters.refused_frames - self.counters.refused_frames) != len(refused):
            raise DisagreementError("a refused frame was not counted")
        believed = expected == "good" and self.ledger.believes(frame.arbitration_id)
        self._compare_values(frame, received, taken=believed, disputed=expected == "good" and not believed)
        stray = (
            verdict_of(frame) == "good" and not believed and frame.arbitration_id == SETPOINT and disarms(frame.data)
        )
        if received.guard_input.stray_disarm is not stray:
            raise DisagreementError("a DISARM out of sequence was not obeyed, or another frame was taken for one")
        self.link, self.counters = received.link, counters
        self.lost += sum(event.count for event in received.events if isinstance(event, FramesLost))
        if self.lost != self.ledger.lost:
            raise DisagreementError(f"{self.lost} lost frames were counted, the oracle counts {self.ledger.lost}")
        return "disputed" if expected == "good" and not believed else expected

    def _compare_values(self, frame: CanFrame, received: Received, *, taken: bool, disputed: bool) -> None:
        """Raise an error unless the frame had the effect that follows from its bytes and the oracle's verdict."""
        given, link = received.guard_input, received.link
        disputes = [event for event in received.events if isinstance(event, FeedbackRefused | OrderDisputed)]
        if disputed and (len(disputes) != 1 or "sequence" not in disputes[0].why):
            raise DisagreementError("a frame of a disputed sender was refused without an event")
        doubts = [event for event in received.events if isinstance(event, FeedbackRefused | SetpointRefused)]
        foreign = [event for event in received.events if isinstance(event, ForeignCommand)]
        orders = given.setpoint_age_ns is not None or given.requests or given.manual
        effect = received.reading or given.feedback_age_ns is not None or orders or foreign
        if not taken and (effect or (doubts and not disputed)):
            raise DisagreementError("a frame that was not taken had an effect")
        kind = frame.arbitration_id
        if not taken or not KINDS[kind].ranges:
            return
        raw = KINDS[kind].ranges[0].raw(frame.data)
        effects = {
            POSITION: (received.reading.position_m if received.reading else None, 1e-8),
            SETPOINT: (link.setpoint.position_m if given.setpoint_age_ns is not None else None, 1e-8),
            MANUAL: (given.manual.current_ma if given.manual else None, 1e-3),
            PRESSURE: (link.pressure_pa, 1.0),
            COMMAND: (foreign[0].current_ma if foreign else None, 1e-3),
        }
        value, unit = effects.get(kind, (None, 1.0))
        if value is not None and abs(value - raw * unit) > 1e-3 * unit:
            raise DisagreementError(f"the value is {value!r}, the oracle reads {raw * unit!r}")
        if value is None and not doubts and kind in effects:
            raise DisagreementError("a frame that was taken had no effect")


class Valve:
    """The emulated valve, one frame at a time."""

    def __init__(self) -> None:
        self.codec, self.ledger = make_codec(), Ledger()
        self.state: DeviceState = initial_device(plant_settings("paper"), 1)

    def receive(self, frame: CanFrame) -> None:
        """Give the frame to the valve and to the oracle.

        Raises:
            DisagreementError: the valve obeys what it should not, or does not obey what it should.
        """
        before, verdict = self.state, verdict_of(frame)
        if verdict == "good" and frame.arbitration_id in {COMMAND, SETPOINT}:
            verdict = self.ledger.enter(frame.arbitration_id, frame.data)
        after = self.state = take(self.codec, before, (frame,))
        obeyed = (after.answered, after.command_counter, after.current_ma, after.signal_failed)
        if verdict == "good" and frame.arbitration_id == COMMAND:
            current_ma = KINDS[COMMAND].ranges[0].raw(frame.data) / 1000
            failed = current_ma <= 3.6 or current_ma >= 21.0
            if obeyed[:2] != (frame.data[5], frame.data[2]) or after.signal_failed is not failed:
                raise DisagreementError("the valve did not obey a good command")
            if not failed and (after.current_ma is None or abs(after.current_ma - current_ma) > 1e-6):
                raise DisagreementError(f"the valve received {after.current_ma!r} mA, the oracle {current_ma!r} mA")
        elif obeyed != (before.answered, before.command_counter, before.current_ma, before.signal_failed):
            raise DisagreementError(f"the valve obeyed a frame that is not to be taken: '{verdict}'")
        if after.setpoints - before.setpoints != (verdict == "good" and frame.arbitration_id == SETPOINT):
            raise DisagreementError("the valve counted a setpoint frame wrongly")


def fuzz(frames: int, seed: int, *, progress: bool = False) -> Findings:
    """Return what `frames` hostile frames of `seed` found.

    Raises:
        DisagreementError: with the seed and the number of the frame.
    """
    adversary, positioner, valve, found = Adversary(seed), Positioner(), Valve(), Findings()
    stream = tqdm(adversary.frames(frames), total=frames, unit=" frames", disable=not progress)
    for number, (attack, frame) in enumerate(stream):
        try:
            verdict = positioner.receive(frame)
            valve.receive(frame)
        except DisagreementError as error:
            raise DisagreementError(f"seed {seed}, frame {number} ({attack}, {frame}): {error}") from None
        found.frames += 1
        found.attacks[attack] += 1
        found.verdicts[verdict] += 1
        found.accidents += attack in DAMAGING and verdict_of(frame) == "good"
    found.counters = positioner.counters
    return found


def main() -> int:
    """Run it from the command line; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--frames", type=int, default=1_300_000, help="how many (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=1, help="which (default: %(default)s)")
    options = parser.parse_args()
    began_s = time.monotonic()
    try:
        found = fuzz(options.frames, options.seed, progress=True)
    except DisagreementError as error:
        sys.stderr.write(f"fuzz: {error}\n")
        return 1
    missing = [name for name in ATTACKS if name not in UNRECEIVED and not found.attacks[name]]
    took = f"{time.monotonic() - began_s:.0f} s, seed {options.seed}"
    sys.stdout.write("\n".join([*found.lines(), took, ""]))
    if missing:
        sys.stderr.write(f"fuzz: too few frames for: {', '.join(missing)}\n")
    return 1 if missing else 0


if __name__ == "__main__":
    raise SystemExit(main())
