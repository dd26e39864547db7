"""The `[wire]` table of a configuration. Pure."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path  # noqa: TC003 - pydantic reads this hint at run time
from typing import Annotated

from annotated_types import Interval, MultipleOf

from positioner.inputs.table import SettingsTable

ID_OFFSETS = range(0, 0x500, 0x80)
"""Allowed offsets of our identifiers, 0x100 to 0x17F: no frame of one valve is then taken for one of another."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MessageSettings(SettingsTable):
    """A message of the user's DBC in place of one of ours, such as `[wire.stem_position]`.

    message: its name in the DBC.
    signals: the signal for each field of our message, such as `{ position_m = "StemPosition" }`.
    counter: the signal with the counter of the frame, where it has one.
    """

    message: str
    signals: dict[str, str]
    counter: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class WireSettings(SettingsTable):
    """The `[wire]` table of a configuration; by default, all messages are ours.

    id_offset: added to the identifiers and data IDs of our frames, so that several valves share one bus; a
        multiple of 128.
    dbc: a DBC file of the user's own, relative to the configuration.
    stem_position, actuator_state, setpoint, current_command: the message of that DBC in place of ours.
    identifiers: other identifiers for single frames of ours, where that DBC gives theirs to other messages.
    """

    id_offset: Annotated[int, Interval(ge=ID_OFFSETS[0], le=ID_OFFSETS[-1]), MultipleOf(ID_OFFSETS.step)] = 0
    dbc: Path | None = None
    stem_position: MessageSettings | None = None
    actuator_state: MessageSettings | None = None
    setpoint: MessageSettings | None = None
    current_command: MessageSettings | None = None
    identifiers: dict[str, Annotated[int, Interval(ge=0, le=0x7FF)]] = field(default_factory=dict)
