"""The codec against cantools: any layout of signals, any bytes, any values; the same bits and the same refusals."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import pytest
from cantools.database.can.message import Message as DbcMessage
from cantools.database.can.signal import Signal
from cantools.database.conversion import BaseConversion
from hypothesis import given, settings
from hypothesis import strategies as st

from positioner.wire import e2e
from positioner.wire.codec import make_codec
from positioner.wire.fields import field_format
from positioner.wire.formats import EncodingError, FrameFormat, FrameRejectedError
from positioner.wire.messages import CanFrame, Counted, Quality, StemPosition

if TYPE_CHECKING:
    from positioner.wire.messages import Message

LENGTHS = {"Position": (1, 64), "Echo": (1, 40), "Quality": (1, 12), "Alive": (2, 20), "Spare": (2, 30)}
OURS = list(make_codec().by_kind.values())
SCALES = (1, 0.01, -0.01, 1e-5, 3.7)


def bits(signal: Signal) -> set[int]:
    """Return the bits of a signal as the DBC counts them: bit n is bit n % 8 of byte n // 8."""
    found, bit = set(), signal.start
    for _ in range(signal.length):
        found.add(bit)
        if signal.byte_order == "little_endian":
            bit += 1
        else:
            bit += 15 if bit % 8 == 0 else -1
    return found


@st.composite
def frames(draw: st.DrawFn) -> FrameFormat:
    """Return a format of STEM_POSITION whose signals lie anywhere in a frame of a user."""
    length = draw(st.integers(2, 8))
    signals: list[Signal] = []
    for name, (shortest, longest) in LENGTHS.items():
        is_float = name == "Position" and draw(st.booleans())
        size = draw(st.sampled_from((16, 32, 64))) if is_float else draw(st.integers(shortest, longest))
        plain = name in {"Echo", "Quality", "Alive"}
        scale = 1 if plain else draw(st.sampled_from(SCALES))
        signal = Signal(
            name,
            draw(st.integers(0, 8 * length - 1)),
            size,
            draw(st.sampled_from(("little_endian", "big_endian"))),
            is_signed=name != "Alive" and draw(st.booleans()),
            raw_initial=draw(st.integers(0, 1)) if name == "Spare" else None,
            conversion=BaseConversion.factory(
                scale, 0 if plain else draw(st.sampled_from((0, -40))), is_float=is_float
            ),
            minimum=draw(st.sampled_from((None, 0))) if plain else None,
            unit="mm" if name == "Position" else None,
        )
        free = set(range(8 * length)) - {bit for other in signals for bit in bits(other)}
        if bits(signal) <= free:
            signals.append(signal)
        elif name == "Position":
            start = 0 if signal.byte_order == "little_endian" else 7
            size = min(size, 8 * length) if not is_float else 16
            signals.append(
                Signal(name, start, size, signal.byte_order, signal.is_signed, conversion=signal.conversion, unit="mm")
            )
    dbc = DbcMessage(0x18FF0001, "Travel", length, signals, is_extended_frame=True)
    names = {signal.name for signal in signals}
    fields = {"position_m": "Position", "command_counter": "Echo", "quality": "Quality"}
    made = [
        field_format(StemPosition, field, dbc.get_signal_by_name(signal), 0.1)
        for field, signal in fields.items()
        if signal in names
    ]
    return FrameFormat(StemPosition, dbc, dbc.frame_id, tuple(made), None, "Alive" if "Alive" in names else None)


def decoded_by_cantools(form: FrameFormat, data: bytes) -> tuple[Message, int | None] | Counted:
    """Return what cantools finds in `data`, or why it must be refused."""
    raw: dict[str, Any] = form.dbc.decode(data, decode_choices=False, scaling=False)  # type: ignore[assignment]
    values: dict[str, Any] = {}
    for field in form.fields:
        value = raw[field.signal]
        if not field.is_whole:
            value = value * field.si_per_bit + field.si_offset
        if not field.lowest <= value <= field.highest:
            return Counted.OUT_OF_RANGE
        if field.choices is not None and value not in field.choices:
            return Counted.UNDEFINED_VALUE
        values[field.name] = value if field.choices is None else field.choices[value]
    counter = None if form.counter is None else raw[form.counter]
    if counter is not None and counter >= form.counter_modulus:
        return Counted.OUT_OF_RANGE
    return form.kind(**values), counter


def encoded_by_cantools(form: FrameFormat, message: StemPosition, counter: int) -> bytes | None:
    """Return the bytes of `message` by cantools, None where a value is out of its range."""
    raw: dict[str, Any] = {signal.name: signal.raw_initial or 0 for signal in form.dbc.signals}
    for field in form.fields:
        value = getattr(message, field.name) or 0
        if not field.lowest <= value <= field.highest:
            return None
        raw[field.signal] = value if field.is_whole else (value - field.si_offset) / field.si_per_bit
    if form.counter is not None:
        raw[form.counter] = counter % form.counter_modulus
    return form.dbc.encode(raw, scaling=False, strict=False)


@given(form=frames() | st.sampled_from(OURS), data=st.binary(min_size=8, max_size=8))
@settings(max_examples=600)
def test_any_bytes_mean_what_cantools_finds_in_them(form: FrameFormat, data: bytes) -> None:
    data = data[: form.dbc.length] if form.data_id is None else e2e.protect(data, form.data_id)
    expected = decoded_by_cantools(form, data)
    frame = CanFrame(form.arbitration_id, data, form.is_extended)
    if isinstance(expected, Counted):
        with pytest.raises(FrameRejectedError) as caught:
            form.decode(frame)
        assert caught.value.counted is expected
    else:
        assert form.decode(frame) == expected


@given(
    form=frames(),
    part=st.floats(-0.001, 1.001),
    echo=st.none() | st.integers(-3, 300),
    quality=st.sampled_from(Quality),
    counter=st.integers(0, 1 << 21),
)
@settings(max_examples=300)
def test_any_message_has_the_bytes_that_cantools_gives_it(
    form: FrameFormat, part: float, echo: int | None, quality: Quality, counter: int
) -> None:
    position = form.fields[0]
    value_m = position.lowest + part * (position.highest - position.lowest)
    message = StemPosition(value_m if math.isfinite(value_m) else position.highest, echo, quality)
    expected = encoded_by_cantools(form, message, counter)
    if expected is None:
        with pytest.raises(EncodingError, match="is out of range"):
            form.encode(message, counter)
    else:
        assert form.encode(message, counter) == CanFrame(form.arbitration_id, expected, is_extended=True)
