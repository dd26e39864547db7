"""The load of a classic CAN bus by the frames of one valve, from its DBC, its period and the bitrate. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from positioner.doctor.finding import Finding, Level
from positioner.wire.messages import ActuatorState, CurrentCommand, PositionerStatus, Setpoint, StemPosition

if TYPE_CHECKING:
    from collections.abc import Sequence

    from positioner.wire.codec import Codec
    from positioner.wire.formats import FrameFormat
    from positioner.wire.messages import Message

WARN_ABOVE = 0.6
REFUSE_ABOVE = 0.9
FASTEST = 1_000_000
_SUBJECT = "bus load"

_EVERY_SAMPLE: tuple[type[Message], ...] = (StemPosition, CurrentCommand)
_CYCLIC: dict[type[Message], float] = {Setpoint: 0.01, ActuatorState: 0.01, PositionerStatus: 0.1}
"""The other cyclic messages, with the period in s where the DBC gives no cycle time."""


@dataclass(frozen=True, slots=True)
class BusLoad:
    """Load of a bus, as a fraction of its bitrate, with the longest form of every frame.

    of_samples: by the frames of every sample; of_others: by the messages with a cycle time of their own.
    shortest_period_s: the sample period at which the load is `REFUSE_ABOVE`; None where `of_others` alone exceeds it.
    """

    of_samples: float
    of_others: float
    shortest_period_s: float | None

    @property
    def total(self) -> float:
        """The load by all frames."""
        return self.of_samples + self.of_others


def frame_bits(data_bytes: int, *, is_extended: bool) -> int:
    """Return the largest number of bits of a classic data frame, with its stuff bits and the gap after it.

    Source: Davis, Burns, Bril and Lukkien, "Controller Area Network (CAN) schedulability analysis", 2007, eq. 1:
    g + 8 s + 13 + ⌊(g + 8 s − 1)/4⌋ with g = 34 bits exposed to stuffing (standard) or 54 (extended).
    """
    exposed = (54 if is_extended else 34) + 8 * data_bytes
    return exposed + 13 + (exposed - 1) // 4


def bus_load(codec: Codec, sample_period_s: float, bitrate: int) -> BusLoad:
    """Return the load by the frames of one valve, without the emulator's PLANT_TRUTH."""
    of_sample_s = sum(_bits(codec.by_kind[kind]) for kind in _EVERY_SAMPLE) / bitrate
    of_others = sum(
        _bits(codec.by_kind[kind]) / bitrate / _cycle_s(codec.by_kind[kind], otherwise_s)
        for kind, otherwise_s in _CYCLIC.items()
    )
    left = REFUSE_ABOVE - of_others
    return BusLoad(of_sample_s / sample_period_s, of_others, of_sample_s / left if left > 0.0 else None)


def findings(
    codec: Codec, sample_period_s: float, name: str, bitrate: int | None, source: str = "FILE"
) -> tuple[Finding, ...]:
    """Return the finding on the load; `bitrate` is None on a virtual bus, `source` the configuration's path."""
    if bitrate is None:
        load = bus_load(codec, sample_period_s, FASTEST)
        text = (
            f"{name} has no bitrate, so no limit; at 1 Mbit/s the load of this valve would be {100 * load.total:.0f} %"
        )
        return (Finding(Level.OK, _SUBJECT, text),)
    load = bus_load(codec, sample_period_s, bitrate)
    text = f"{100 * load.total:.0f} % of {bitrate / 1000:g} kbit/s at most, with {1.0 / sample_period_s:g} samples/s"
    if load.total <= WARN_ABOVE:
        return (Finding(Level.OK, _SUBJECT, text),)
    if load.shortest_period_s is None:
        return (Finding(Level.FAIL, _SUBJECT, f"{text}: too slow for any sample period", _faster(name)),)
    shortest_s = rounded_up(load.shortest_period_s)
    slower = f"sudoedit {source}  # [control] sample_period_s, and the sensor's period with it"
    fix = _faster(name) if bitrate < FASTEST else slower
    if load.total <= REFUSE_ABOVE:
        text += f", above {100 * WARN_ABOVE:.0f} %: other nodes on this bus have to wait for this valve"
        return (Finding(Level.WARN, _SUBJECT, text, fix),)
    text += f"; the shortest period that fits is {shortest_s:g} s: {1.0 / shortest_s:.0f} samples/s"
    return (Finding(Level.FAIL, _SUBJECT, text, slower),)


def is_too_much(codec: Codec, sample_period_s: float, bitrate: int = FASTEST) -> bool:
    """Return whether the frames of one valve are more than a bus carries."""
    return bus_load(codec, sample_period_s, bitrate).total > REFUSE_ABOVE


def in_words(codec: Codec, sample_period_s: float, bitrate: int = FASTEST) -> str:
    """Return the load at `bitrate` in words, with the shortest sample period that the bus can carry."""
    load = bus_load(codec, sample_period_s, bitrate)
    text = f"{100 * load.total:.0f} % of {bitrate / 1e6:g} Mbit/s at most"
    if load.shortest_period_s is None:
        return f"{text}: too slow for any sample period"
    shortest_ms = rounded_up(load.shortest_period_s) * 1e3
    fits = f"{100 * REFUSE_ABOVE:.0f} % at {shortest_ms:.2f} ms, the shortest period that fits"
    return f"{text}; {fits}" if load.total <= REFUSE_ABOVE else f"{text}: more than the bus carries; {fits}"


def of_several(name: str, valves: Sequence[tuple[Codec, float]], bitrate: int = FASTEST) -> Finding:
    """Return the finding on the load of a bus by several valves, each with its codec and its sample period in s."""
    load = sum(bus_load(codec, period_s, bitrate).total for codec, period_s in valves)
    text = f"{name} with {len(valves)} valves: {100 * load:.0f} % of {bitrate / 1e6:g} Mbit/s at most"
    if load <= WARN_ABOVE:
        return Finding(Level.OK, _SUBJECT, text)
    level = Level.WARN if load <= REFUSE_ABOVE else Level.FAIL
    return Finding(level, _SUBJECT, f"{text}: {'other nodes have to wait' if level is Level.WARN else 'too much'}")


def rounded_up(period_s: float) -> float:
    """Return the period in s rounded up to whole µs."""
    return -(-round(period_s * 1e9) // 1000) / 1e6


def _faster(name: str) -> str:
    up = f"sudo ip link set {name} up type can bitrate {FASTEST}"
    return f"sudo ip link set {name} down && {up}  # and every other node on the bus alike"


def _bits(form: FrameFormat) -> int:
    return frame_bits(form.dbc.length, is_extended=form.dbc.is_extended_frame)


def _cycle_s(form: FrameFormat, otherwise_s: float) -> float:
    """Return the cycle time of the DBC (GenMsgCycleTime, in ms) in s."""
    return form.dbc.cycle_time / 1e3 if form.dbc.cycle_time else otherwise_s
