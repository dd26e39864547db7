"""The identifiers of our frames, and that no other message has the same. Pure."""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING

from positioner.errors import Problem
from positioner.inputs.nearest import nearest
from positioner.wire.messages import PlantTruth

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping, Sequence

    from cantools.database.can.message import Message as DbcMessage

    from positioner.wire.formats import FrameFormat

_HOW = "give ours another with wire.identifiers.{} = 0x7F0, for example, or move all of ours with wire.id_offset"


def named(identifiers: Mapping[str, int], ours: Collection[str], theirs: Collection[str]) -> Iterator[Problem]:
    """Yield a problem for every wrong name in `identifiers`: it must be in `ours`, and not in `theirs`, the user's."""
    for name, identifier in identifiers.items():
        where = f"wire.identifiers.{name} = 0x{identifier:X}"
        if name not in ours:
            yield Problem(where, None, f"is no frame of ours; {nearest(name, ours)}")
        elif name in theirs:
            yield Problem(where, None, f"wire.{name} names a message of your own, whose identifier the DBC gives")


def shared(formats: Sequence[FrameFormat]) -> Iterator[Problem]:
    """Yield a problem for every two messages under one identifier: a frame holds one message."""
    for one, other in combinations(formats, 2):
        if _address(one) == _address(other):
            text = f"{one.dbc.name} and {other.dbc.name} share the identifier {one.arbitration_id:X}"
            yield Problem("wire.dbc", None, text)


def taken(formats: Sequence[FrameFormat], user_messages: Sequence[DbcMessage]) -> Iterator[Problem]:
    """Yield a problem for every frame of ours under an identifier that the user's DBC gives to another message.

    Other nodes would take our frame for theirs, and we theirs for ours. PLANT_TRUTH is exempt: only benches send it.
    """
    used = {form.dbc.name for form in formats if form.data_id is None}
    theirs = {
        (message.frame_id, message.is_extended_frame): message.name
        for message in user_messages
        if message.name not in used
    }
    for form in formats:
        name = theirs.get(_address(form))
        if form.data_id is not None and form.kind is not PlantTruth and name not in {None, form.dbc.name}:
            text = f"gives the identifier {form.arbitration_id:X} of our {form.dbc.name} to {name}"
            yield Problem("wire.dbc", None, f"{text}: {_HOW.format(form.dbc.name.lower())}")


def _address(form: FrameFormat) -> tuple[int, bool]:
    return form.arbitration_id, form.dbc.is_extended_frame
