"""The rules for every frame of a node: format, CRC, values, spare bits, counter. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.conformance.crc_mistakes import mistake
from positioner.conformance.rules import Results, Rule, Violation
from positioner.wire import e2e
from positioner.wire.formats import FrameRejectedError
from positioner.wire.messages import CurrentCommand, PositionerAlarms, PositionerCount, PositionerStatus

if TYPE_CHECKING:
    from collections.abc import Iterable

    from positioner.wire.codec import Codec
    from positioner.wire.formats import FrameFormat
    from positioner.wire.messages import CanFrame, Message

_OF_POSITIONER = (CurrentCommand, PositionerStatus, PositionerCount, PositionerAlarms)
FRAME_RULES = (
    Rule(
        "format",
        "data frames of eight bytes under an 11-bit identifier",
        "send classic CAN data frames with eight bytes and a standard identifier",
    ),
    Rule(
        "crc",
        "bytes 0 and 1 are the CRC of bytes 2 to 7 and the data ID",
        "compute the CRC as in docs/protocol.md, and compare with its test vectors",
    ),
    Rule(
        "values",
        "every signal is within its range, and every state is one that the DBC lists",
        "send values within the ranges of the DBC, and only states that it lists",
    ),
    Rule("spare", "bits that belong to no signal are 0", "fill the frame with 0 before you write the signals into it"),
    Rule(
        "counter",
        "each frame of a message adds 1 to the counter of that message, and 0 follows 255",
        "give each message a counter of its own, add 1 for each frame, and lose none",
    ),
    Rule(
        "identifiers",
        "nothing else comes under the positioner's identifiers: commands, status, counts, POSITIONER_ALARMS",
        "give that message another identifier, or move all of ours by id_offset, here and in [wire]",
    ),
)


class FrameChecks:
    """Checks the frames of one node; mutable."""

    def __init__(self, codec: Codec, kinds: Iterable[type[Message]], results: Results, id_offset: int) -> None:
        """Prepare the checks; `kinds` are the messages that the node sends."""
        self._codec = codec
        self._forms, self._positioner = (
            {codec.by_kind[kind].arbitration_id: codec.by_kind[kind] for kind in each}
            for each in (kinds, _OF_POSITIONER)
        )
        self._results = results
        self._id_offset = id_offset
        self._counters: dict[type[Message], int] = {}

    def receive(self, frame: CanFrame) -> tuple[Message, int] | None:
        """Return the message in `frame` and its counter; None for another node's frame, and for an unreadable one."""
        form = self._forms.get(frame.arbitration_id)
        self._check_identifier(frame, is_own=form is not None)
        if form is None or frame.is_error or not self._keeps_format(frame) or not self._keeps_crc(frame, form):
            return None
        try:
            message, counter = self._codec.decode(frame)
        except FrameRejectedError as error:
            self._results.failed("values", Violation(str(error), frame))
            return None
        self._results.passed("values")
        assert counter is not None  # noqa: S101 - for the type checker: each of our messages has one
        same = self._codec.encode(message, counter).data == frame.data
        self._results.note("spare", None if same else Violation(f"{form.dbc.name} has a spare bit of 1", frame))
        self._check_counter(frame, form, counter)
        return message, counter

    def _check_identifier(self, frame: CanFrame, *, is_own: bool) -> None:
        """Check that a frame under an identifier of the positioner is the positioner's."""
        form = self._positioner.get(frame.arbitration_id)
        if form is not None and not (frame.is_extended or frame.is_error):
            whole = not frame.is_remote and len(frame.data) == 8  # noqa: PLR2004 - classic CAN
            if not (whole and e2e.is_intact(frame.data, form.data_id or 0)):
                found = f"a frame under {frame.arbitration_id:X} that is no {form.dbc.name}"
                self._results.failed("identifiers", Violation(found, frame))
        elif is_own:
            self._results.passed("identifiers")

    def _keeps_format(self, frame: CanFrame) -> bool:
        odd = [
            *(["an extended identifier"] if frame.is_extended else []),
            *(["a remote frame"] if frame.is_remote else []),
            *([f"{len(frame.data)} bytes"] if len(frame.data) != 8 else []),  # noqa: PLR2004 - classic CAN
        ]
        self._results.note("format", Violation(" and ".join(odd), frame) if odd else None)
        return not odd

    def _keeps_crc(self, frame: CanFrame, form: FrameFormat) -> bool:
        data_id = form.data_id or 0
        if e2e.is_intact(frame.data, data_id):
            self._results.passed("crc")
            return True
        right, sent = (int.from_bytes(data[:2], "little") for data in (e2e.protect(frame.data, data_id), frame.data))
        found = f"{form.dbc.name} has the CRC {sent:04X}; with the data ID {data_id:04X} it must be {right:04X}"
        self._results.failed("crc", Violation(found, frame, mistake(frame.data, data_id, self._id_offset)))
        return False

    def _check_counter(self, frame: CanFrame, form: FrameFormat, counter: int) -> None:
        last = self._counters.get(form.kind)
        self._counters[form.kind] = counter
        if last is not None:
            follows = (counter - last) % form.counter_modulus == 1
            found = f"{form.dbc.name} has the counter {counter} after {last}"
            self._results.note("counter", None if follows else Violation(found, frame))


def check_travel(
    results: Results, travel_m: tuple[float, float] | None, signal: str, position_m: float, frame: CanFrame
) -> None:
    """Check the rule "travel": that `signal` is within `travel_m`; nothing where that is None."""
    if travel_m is not None:
        inside = travel_m[0] <= position_m <= travel_m[1]
        results.note("travel", None if inside else Violation(f"{signal} = {position_m * 1e3:g}", frame))
