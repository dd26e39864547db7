"""A bus with true senders and an adversary: damage, loss, replay, reordering, masquerade, restarts, chance. Seeded."""

from __future__ import annotations

import random
from collections import Counter, deque
from dataclasses import replace
from typing import TYPE_CHECKING

from e2e import p05

from endurance.oracle import KINDS
from positioner.wire.codec import make_codec
from positioner.wire.messages import (
    ActuatorState,
    CanFrame,
    CurrentCommand,
    HostRequest,
    ManualCurrent,
    ManualRequest,
    Mode,
    Motion,
    PlantTruth,
    Quality,
    Setpoint,
    StemPosition,
)
from positioner.wire.settings import ID_OFFSETS, WireSettings

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from positioner.wire.messages import Message

TRUE = "true"
HOSTILITY = (0.85, 0.2)
"""Shares of the frames that are attacked, by turns: in the quiet parts a dispute ends, so that another can begin."""
LULL_FRAMES = 400
HISTORY = 600
"""Frames that the adversary remembers: more than two wraps of a counter."""


class Adversary:
    """The frames that a receiver gets, each with the name of the attack on it."""

    def __init__(self, seed: int) -> None:
        self.chance = random.Random(seed)  # noqa: S311 - attacks that can be repeated, no secret
        self.codec = make_codec()
        self.neighbours = [make_codec(WireSettings(id_offset=offset)) for offset in ID_OFFSETS[1:]]
        self.counters: Counter[type[Message]] = Counter()
        self.history: deque[CanFrame] = deque(maxlen=HISTORY)
        self.position_m = 0.08

    def frames(self, number: int) -> Iterator[tuple[str, CanFrame]]:
        """Yield `number` frames, most of them attacks."""
        made = 0
        while made < number:
            true = self.true_frame()
            received = [(TRUE, true)]
            if self.chance.random() < HOSTILITY[made // LULL_FRAMES % len(HOSTILITY)]:
                attack = self.chance.choice(list(ATTACKS))
                received = [(attack, frame) for frame in ATTACKS[attack](self, true)]
            self.history.append(true)
            yield from received[: number - made]
            made += len(received)

    def true_message(self) -> Message:
        chance = self.chance
        self.position_m = min(max(self.position_m + chance.uniform(-2e-3, 2e-3), 0.0), 0.1397)
        byte = chance.randrange(256)
        return chance.choice(
            (
                StemPosition(self.position_m, byte, chance.choice((Quality.VALID, Quality.SUSPECT))),
                StemPosition(self.position_m, byte),
                Setpoint(chance.uniform(0.0, 0.1397), chance.choice(list(HostRequest))),
                ManualCurrent(chance.uniform(0.0, 25.0), chance.choice(list(ManualRequest))),
                CurrentCommand(
                    chance.uniform(0.0, 25.0), byte, byte, chance.choice(list(Mode)), chance.choice(list(Motion))
                ),
                ActuatorState(chance.uniform(0.0, 16e6)),
                PlantTruth(self.position_m, chance.uniform(-8.0, 8.0)),
            )
        )

    def true_frame(self) -> CanFrame:
        message = self.true_message()
        self.counters[type(message)] += 1
        return self.codec.encode(message, self.counters[type(message)])

    def counts_from(self, true: CanFrame, counter: int) -> None:
        """Let the sender of `true` go on from `counter`."""
        self.counters[type(self.codec.decode(true)[0])] = counter


def xored(true: CanFrame, pattern: int) -> CanFrame:
    """Return `true` with the bits of `pattern` flipped, in the order of transmission."""
    return replace(true, data=(int.from_bytes(true.data, "big") ^ pattern).to_bytes(8, "big"))


def damaged(it: Adversary, true: CanFrame) -> list[CanFrame]:
    return [xored(true, sum(1 << bit for bit in it.chance.sample(range(64), it.chance.choice((1, 2, 3, 4, 5, 8, 20)))))]


def burst(it: Adversary, true: CanFrame) -> list[CanFrame]:
    length = it.chance.randint(2, 40)
    return [xored(true, (1 << (length - 1) | it.chance.getrandbits(length) | 1) << it.chance.randint(0, 64 - length))]


def truncated(it: Adversary, true: CanFrame) -> list[CanFrame]:
    return [replace(true, data=true.data[: it.chance.randrange(8)])]


def lengthened(it: Adversary, true: CanFrame) -> list[CanFrame]:
    return [replace(true, data=true.data + it.chance.randbytes(it.chance.choice((1, 4, 8, 56))))]


def replayed(it: Adversary, true: CanFrame) -> list[CanFrame]:
    return [it.chance.choice(it.history) if it.history else true]


def repeated(it: Adversary, true: CanFrame) -> list[CanFrame]:
    del it
    return [true, true]


def reordered(it: Adversary, true: CanFrame) -> list[CanFrame]:
    return [it.true_frame(), true]


def lost(it: Adversary, true: CanFrame) -> list[CanFrame]:
    _, counter = it.codec.decode(true)
    it.counts_from(true, (counter or 0) + it.chance.choice((0, 1, 2, 9, 10, 11, 12, 100, 244, 245, 254, 255)))
    return []


def restarted(it: Adversary, true: CanFrame) -> list[CanFrame]:
    it.counts_from(true, it.chance.choice((-1, it.chance.randrange(256))))
    return []


def masqueraded(it: Adversary, true: CanFrame) -> list[CanFrame]:
    return [replace(true, arbitration_id=it.chance.choice([each for each in KINDS if each != true.arbitration_id]))]


def other_valve(it: Adversary, true: CanFrame) -> list[CanFrame]:
    foreign = it.chance.choice(it.neighbours).encode(it.codec.decode(true)[0], it.chance.randrange(256))
    return [replace(foreign, arbitration_id=true.arbitration_id)]


def chance_frame(it: Adversary, true: CanFrame) -> list[CanFrame]:
    del true
    return [CanFrame(it.chance.choice(list(KINDS)), it.chance.randbytes(8))]


def other_traffic(it: Adversary, true: CanFrame) -> list[CanFrame]:
    del true
    return [CanFrame(it.chance.randrange(0x180, 0x800), it.chance.randbytes(it.chance.randrange(9)))]


def flagged(it: Adversary, true: CanFrame) -> list[CanFrame]:
    error, remote, extended = it.chance.choice(((True, False, False), (False, True, False), (False, False, True)))
    return [replace(true, is_error=error, is_remote=remote, is_extended=extended)]


def badly_made(it: Adversary, true: CanFrame) -> list[CanFrame]:
    """Return a frame with a true CRC and the content that a broken sender may give it."""
    identifier = it.chance.choice(list(KINDS))
    payload = bytearray(true.data[:3] + it.chance.randbytes(5))
    p05.e2e_p05_protect(payload, KINDS[identifier].data_id, increment_counter=False)
    return [CanFrame(identifier, bytes(payload))]


ATTACKS: Mapping[str, Callable[[Adversary, CanFrame], list[CanFrame]]] = {
    "damaged": damaged,
    "burst": burst,
    "truncated": truncated,
    "lengthened": lengthened,
    "replayed": replayed,
    "repeated": repeated,
    "reordered": reordered,
    "lost": lost,
    "restarted": restarted,
    "masqueraded": masqueraded,
    "other valve": other_valve,
    "random": chance_frame,
    "other traffic": other_traffic,
    "flagged": flagged,
    "badly made": badly_made,
}
DAMAGING = frozenset({"damaged", "burst", "truncated", "lengthened", "masqueraded", "other valve", "random", "flagged"})
"""Attacks that only an accident of the CRC lets through."""
UNRECEIVED = frozenset({"lost", "restarted"})
"""Attacks that are visible in later frames only."""
