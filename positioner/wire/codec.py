"""The codec: frames to typed messages and back, for our own DBC or a user's. Pure.

Our frames are described by `dbc/positioner.dbc` alone. A user whose hardware speaks other frames names his DBC, his
messages and his signals in `[wire]` (see `foreign`); all others stay ours.
"""

from __future__ import annotations

from functools import cache
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

from positioner.errors import ConfigurationError, Problem
from positioner.machine.can_libraries import cantools
from positioner.wire import foreign, identifiers, messages, ranges
from positioner.wire.fields import FieldFormat, field_format, field_names
from positioner.wire.formats import FrameFormat, FrameRejectedError
from positioner.wire.messages import Counted
from positioner.wire.settings import ID_OFFSETS, WireSettings

if TYPE_CHECKING:
    from collections.abc import Mapping

    from cantools.database.can import Database
    from cantools.database.can.message import Message as DbcMessage

    from positioner.wire.messages import CanFrame, Message

_OWN_NAMES: Mapping[type[Message], tuple[str, Mapping[str, str]]] = {
    messages.StemPosition: (
        "STEM_POSITION",
        {"position_m": "Position_mm", "command_counter": "CommandCounter", "quality": "Quality"},
    ),
    messages.ActuatorState: ("ACTUATOR_STATE", {"pressure_pa": "Pressure_kPa"}),
    messages.Setpoint: ("SETPOINT", {"setpoint_m": "Setpoint_mm", "request": "Request"}),
    messages.ManualCurrent: ("MANUAL_CURRENT", {"current_ma": "Current_mA", "request": "Request"}),
    messages.CurrentCommand: (
        "CURRENT_COMMAND",
        {
            "current_ma": "Current_mA",
            "position_counter": "PositionCounter",
            "setpoint_counter": "SetpointCounter",
            "mode": "Mode",
            "motion": "Motion",
        },
    ),
    messages.PositionerStatus: (
        "POSITIONER_STATUS",
        {
            "mode": "Mode",
            "cause": "Cause",
            "health": "Health",
            "armed": "Armed",
            "table_saved": "TableSaved",
            "fallback_count": "FallbackCount",
            "rejected_count": "RejectedCount",
            "learned_count": "LearnedCount",
        },
    ),
    messages.PositionerCount: ("POSITIONER_COUNT", {"counted": "Counted", "count": "Count"}),
    messages.PositionerAlarms: (
        "POSITIONER_ALARMS",
        {"worst": "Worst", "count": "Count", "active": "Active", "unacknowledged": "Unacknowledged"},
    ),
    messages.PlantTruth: (
        "PLANT_TRUTH",
        {"position_m": "TruePosition_mm", "velocity_m_per_s": "TrueVelocity_mm_per_s"},
    ),
}


_USER_KINDS: Mapping[str, type[Message]] = {
    "stem_position": messages.StemPosition,
    "actuator_state": messages.ActuatorState,
    "setpoint": messages.Setpoint,
    "current_command": messages.CurrentCommand,
}


class Codec:
    """Formats by kind of message and by identifier (with its extended flag); immutable by convention."""

    def __init__(self, by_kind: Mapping[type[Message], FrameFormat]) -> None:
        self.by_kind = by_kind
        self.by_id = {(form.arbitration_id, form.is_extended): form for form in by_kind.values()}
        self._fields = {(kind, each.name): each for kind, form in by_kind.items() for each in form.fields}

    def identifier(self, kind: type[Message]) -> tuple[int, bool]:
        """Return the identifier under which `kind` travels, and whether it is an extended one."""
        form = self.by_kind[kind]
        return form.arbitration_id, form.is_extended

    def field(self, kind: type[Message], name: str) -> FieldFormat:
        """Return how the field `name` of `kind` is coded in its signal."""
        return self._fields[kind, name]

    def carries(self, kind: type[Message], name: str) -> bool:
        """Return whether the frames of `kind` have a signal for the field `name`."""
        return (kind, name) in self._fields

    def decode(self, frame: CanFrame) -> tuple[Message, int | None]:
        """Return the message in `frame` and its counter.

        Raises:
            FrameRejectedError: the frame is unknown, damaged or out of range.
        """
        if frame.is_error:
            raise FrameRejectedError(Counted.ERROR_FRAME, f"id {frame.arbitration_id:X}")
        form = self.by_id.get((frame.arbitration_id, frame.is_extended))
        if form is None:
            raise FrameRejectedError(None, f"id {frame.arbitration_id:X}")
        if frame.is_remote:
            raise FrameRejectedError(Counted.REMOTE_FRAME, form.dbc.name)
        return form.decode(frame)

    def encode(self, message: Message, counter: int) -> CanFrame:
        """Return the frame of `message`.

        Raises:
            EncodingError: a value does not fit its signal.
        """
        return self.by_kind[type(message)].encode(message, counter)


def packaged_dbc_text() -> str:
    """Return the text of our DBC: from the installed package, or from the source tree's `dbc/`."""
    packaged = resources.files("positioner.wire") / "positioner.dbc"
    if packaged.is_file():
        return packaged.read_text(encoding="utf-8")
    return (Path(__file__).resolve().parents[2] / "dbc" / "positioner.dbc").read_text(encoding="utf-8")


@cache
def own_database() -> Database:
    """Return our DBC, parsed."""
    database = cantools.database.load_string(packaged_dbc_text(), "dbc")
    # for the type checker: "dbc" gives no other kind
    assert isinstance(database, cantools.database.can.Database)  # noqa: S101
    return database


def make_codec(settings: WireSettings | None = None, *, span_m: float = 0.127) -> Codec:
    """Return the codec for `settings`; 100 % of a signal in percent is `span_m`.

    Raises:
        ConfigurationError: the user's DBC is missing or lacks what the settings name; with every mistake at once.
    """
    settings = settings or WireSettings()
    formats = {kind: _own_format(kind, settings) for kind in _OWN_NAMES}
    wanted = {name: chosen for name in _USER_KINDS if (chosen := getattr(settings, name)) is not None}
    problems: list[Problem] = []
    if settings.id_offset not in ID_OFFSETS:  # settings that no file reader has checked
        allowed = f"must be a multiple of {ID_OFFSETS.step} up to {ID_OFFSETS[-1]}"
        problems.append(Problem(f"wire.id_offset = {settings.id_offset}", None, allowed))
    user_messages: tuple[DbcMessage, ...] = ()
    ours = [name.lower() for name, _ in _OWN_NAMES.values()]
    problems += identifiers.named(settings.identifiers, ours, wanted)
    if settings.dbc is not None:
        user_messages = foreign.read_messages(settings.dbc, problems)
        for name, chosen in wanted.items() if user_messages else ():
            form = foreign.frame_format(_USER_KINDS[name], f"wire.{name}", chosen, user_messages, span_m, problems)
            if form is not None:
                formats[form.kind] = form
    elif wanted:
        problems.append(Problem("wire.dbc", None, "is missing: name the DBC file that holds your messages"))
    problems += ranges.echo_problems(formats)
    problems += identifiers.shared(tuple(formats.values()))
    problems += identifiers.taken(tuple(formats.values()), user_messages)
    if problems:
        raise ConfigurationError("[wire]", tuple(problems))
    return Codec(formats)


def _own_format(kind: type[Message], settings: WireSettings) -> FrameFormat:
    name, signals = _OWN_NAMES[kind]
    dbc = own_database().get_message_by_name(name)
    assert dbc.dbc is not None  # noqa: S101 - for the type checker: a message read from a DBC has its DBC part
    data_id = int(dbc.dbc.attributes["E2eDataId"].value) + settings.id_offset
    made = tuple(field_format(kind, each, dbc.get_signal_by_name(signals[each]), 1.0) for each in field_names(kind))
    identifier = settings.identifiers.get(name.lower(), dbc.frame_id + settings.id_offset)
    return FrameFormat(kind, dbc, identifier, made, data_id, "Counter")
