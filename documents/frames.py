"""The reference of the frames, from the DBC: messages, and their signals with units. Shell, because it reads a file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from cantools.database.can import Database

if TYPE_CHECKING:
    from cantools.database.can import Message, Signal

DBC = Path(__file__).resolve().parents[1] / "dbc" / "positioner.dbc"
_INTRODUCTION = """\
# Frames

Every message of the [DBC](../files/dbc/positioner.dbc) with its signals. [The protocol](../protocol.md) says who sends
them when, how CRC and counters are formed, and gives test vectors. Identifiers are those without `wire.id_offset`. Bits
are counted from 0, the lowest bit of the first byte; signals are little-endian.
"""


def page() -> str:
    """Return the reference in Markdown."""
    database = Database()
    database.add_dbc_file(DBC)
    messages = sorted(database.messages, key=lambda message: message.frame_id)
    return _INTRODUCTION + "".join(_section(message) for message in messages)


def _section(message: Message) -> str:
    sender = ", ".join(name.lower() for name in message.senders)
    every = f", every {message.cycle_time:g} ms" if message.cycle_time else ""
    lines = [
        f"\n## {message.name}\n",
        f"{message.comment}\n",
        f"Identifier 0x{message.frame_id:03X}, {message.length} bytes, from the {sender}{every}.\n",
        "| signal | bits | range | step | unit | values |",
        "|---|---|---|---|---|---|",
        *(_row(signal) for signal in message.signals),
    ]
    return "\n".join(lines) + "\n"


def _row(signal: Signal) -> str:
    bits = f"{signal.start} to {signal.start + signal.length - 1}{', signed' if signal.is_signed else ''}"
    values = ", ".join(f"{number} {name}" for number, name in (signal.choices or {}).items())
    limits = "" if values or signal.minimum is None else f"{signal.minimum:g} to {signal.maximum:g}"
    return f"| `{signal.name}` | {bits} | {limits} | {signal.scale:g} | {signal.unit or ''} | {values} |"
