"""Our frames: golden bytes, round trips, and what is refused in each direction."""

from __future__ import annotations

import itertools
import math
from dataclasses import asdict, replace
from typing import TYPE_CHECKING

import pytest
from e2e import p05
from hypothesis import given, settings
from hypothesis import strategies as st

from positioner.errors import ConfigurationError
from positioner.inputs.toml_reader import parse
from positioner.wire.codec import make_codec
from positioner.wire.formats import EncodingError, FrameRejectedError
from positioner.wire.messages import (
    ActuatorState,
    CanFrame,
    Cause,
    Counted,
    CurrentCommand,
    Health,
    HostRequest,
    ManualCurrent,
    ManualRequest,
    Mode,
    Motion,
    PlantTruth,
    PositionerAlarms,
    PositionerCount,
    PositionerStatus,
    Quality,
    Setpoint,
    StemPosition,
)
from positioner.wire.settings import ID_OFFSETS, WireSettings

if TYPE_CHECKING:
    from positioner.wire.messages import Message

CODEC = make_codec()
STATUS = PositionerStatus(
    mode=Mode.FAILSAFE,
    cause=Cause.FEEDBACK_FROZEN,
    health=Health.FAILURE,
    armed=True,
    table_saved=False,
    fallback_count=1,
    rejected_count=2,
    learned_count=3,
)

# (message, counter, identifier, data ID, [(start bit, length, raw value)], bytes on the wire)
Golden = tuple["Message", int, int, int, list[tuple[int, int, int]], str]
GOLDEN: list[Golden] = [
    (
        StemPosition(0.0834567, 200, Quality.SUSPECT),
        *(5, 0x110, 0x1F10, [(24, 28, 8345670), (52, 8, 200), (60, 4, 1)], "77 0b 05 46 58 7f 80 1c"),
    ),
    (
        StemPosition(-0.001, 255, Quality.FAULT),
        *(255, 0x110, 0x1F10, [(24, 28, -100000), (52, 8, 255), (60, 4, 2)], "12 ea ff 60 79 fe ff 2f"),
    ),
    (ActuatorState(123457.0), 0, 0x111, 0x1F11, [(24, 24, 123457)], "06 2d 00 41 e2 01 00 00"),
    (
        Setpoint(0.1, HostRequest.DISARM),
        *(171, 0x120, 0x1F20, [(24, 28, 10000000), (52, 4, 2)], "15 7f ab 80 96 98 20 00"),
    ),
    (
        ManualCurrent(9.5),
        *(255, 0x121, 0x1F21, [(24, 16, 9500), (40, 4, 1)], "30 ca ff 1c 25 01 00 00"),
    ),
    (
        CurrentCommand(12.345, 17, 34, Mode.HOLD, Motion.SETTLE),
        *(16, 0x100, 0x1F00, [(24, 16, 12345), (40, 8, 17), (48, 8, 34), (56, 4, 3), (60, 4, 3)]),
        "41 5a 10 39 30 11 22 33",
    ),
    (
        STATUS,
        *(7, 0x140, 0x1F40, [(24, 4, 4), (28, 4, 4), (32, 6, 12), (38, 1, 1), (40, 8, 1), (48, 8, 2), (56, 8, 3)]),
        "84 7b 07 44 4c 01 02 03",
    ),
    (PlantTruth(0.05, -0.25), 9, 0x170, 0x1F70, [(24, 26, 6000000), (50, 14, -250)], "b0 43 09 80 8d 5b 18 fc"),
]
MESSAGES = [golden[0] for golden in GOLDEN]


def bitwise_crc(data: bytes) -> int:
    """Return the CRC-16 0x1021, start 0xFFFF, one bit at a time, as the standard describes it."""
    register = 0xFFFF
    for byte in data:
        register ^= byte << 8
        for _ in range(8):
            register = ((register << 1) ^ 0x1021 if register & 0x8000 else register << 1) & 0xFFFF
    return register


def by_hand(counter: int, data_id: int, signals: list[tuple[int, int, int]]) -> bytes:
    """Return the bytes of a frame, packed without the DBC: little-endian fields, then the CRC."""
    word = counter << 16
    for start, length, raw in signals:
        word |= (raw & ((1 << length) - 1)) << start
    body = word.to_bytes(8, "little")[2:]
    return bitwise_crc(body + data_id.to_bytes(2, "little")).to_bytes(2, "little") + body


def reason_for(frame: CanFrame) -> Counted | None:
    with pytest.raises(FrameRejectedError) as caught:
        CODEC.decode(frame)
    counted = caught.value.counted
    assert str(caught.value).startswith(counted.text if counted is not None else "unknown identifier")
    return caught.value.counted


@pytest.mark.parametrize("golden", GOLDEN, ids=lambda golden: type(golden[0]).__name__)
def test_a_frame_has_its_golden_bytes(golden: Golden) -> None:
    message, counter, identifier, data_id, signals, expected = golden
    frame = CODEC.encode(message, counter)
    assert frame == CanFrame(identifier, bytes.fromhex(expected))
    assert frame.data == by_hand(counter, data_id, signals)
    assert p05.e2e_p05_check(frame.data, data_id)


@pytest.mark.parametrize("golden", GOLDEN, ids=lambda golden: type(golden[0]).__name__)
def test_golden_bytes_decode_to_their_message(golden: Golden) -> None:
    message, counter, identifier, _, _, data = golden
    decoded, decoded_counter = CODEC.decode(CanFrame(identifier, bytes.fromhex(data)))
    assert type(decoded) is type(message)
    assert asdict(decoded) == pytest.approx(asdict(message), rel=1e-12)
    assert decoded_counter == counter


def test_enumerations_come_back_as_their_own_type() -> None:
    decoded, _ = CODEC.decode(CODEC.encode(STATUS, 0))
    assert isinstance(decoded, PositionerStatus)
    assert isinstance(decoded.mode, Mode)
    assert isinstance(decoded.cause, Cause)
    assert decoded.armed is True
    assert decoded.table_saved is False
    assert isinstance(decoded.learned_count, int)


BYTE = st.integers(0, 255)
POSITION = st.floats(-1.342, 1.342)
ANY_MESSAGE = st.one_of(
    st.builds(StemPosition, POSITION, BYTE, st.sampled_from(Quality)),
    st.builds(ActuatorState, st.floats(0.0, 16e6)),
    st.builds(Setpoint, POSITION, st.sampled_from(HostRequest)),
    st.builds(ManualCurrent, st.floats(0.0, 25.0), st.sampled_from(ManualRequest)),
    st.builds(CurrentCommand, st.floats(0.0, 25.0), BYTE, BYTE, st.sampled_from(Mode), st.sampled_from(Motion)),
    st.builds(
        PositionerStatus,
        *(st.sampled_from(Mode), st.sampled_from(Cause), st.sampled_from(Health)),
        *(st.booleans(), st.booleans(), BYTE, BYTE, BYTE),
    ),
    st.builds(
        PositionerAlarms,
        st.sampled_from(Health),
        st.integers(0, 15),
        st.integers(0, 65535),
        st.integers(0, 65535),
    ),
    st.builds(PositionerCount, st.sampled_from(Counted), st.integers(0, 2**32 - 1)),
    st.builds(PlantTruth, st.floats(-0.01, 0.661), st.floats(-8.191, 8.191)),
)
HALF_BIT = {"position_m": 5e-9, "setpoint_m": 5e-9, "current_ma": 5e-4, "pressure_pa": 0.5, "velocity_m_per_s": 5e-4}


@given(message=ANY_MESSAGE, counter=BYTE)
@settings(max_examples=400)
def test_every_message_comes_back_within_half_a_bit(message: Message, counter: int) -> None:
    decoded, decoded_counter = CODEC.decode(CODEC.encode(message, counter))
    assert type(decoded) is type(message)
    assert decoded_counter == counter
    back = asdict(decoded)
    for name, value in asdict(message).items():
        assert back[name] == pytest.approx(value, abs=HALF_BIT.get(name, 0.0) * (1.0 + 1e-6), rel=0.0)


@given(message=ANY_MESSAGE)
@settings(max_examples=50)
def test_encoding_what_was_decoded_gives_the_same_bytes(message: Message) -> None:
    frame = CODEC.encode(message, 77)
    decoded, _ = CODEC.decode(frame)
    assert CODEC.encode(decoded, 77) == frame


def test_a_running_counter_wraps_at_256_and_no_echo_is_sent_as_0() -> None:
    decoded, counter = CODEC.decode(CODEC.encode(StemPosition(0.0), 256 + 3))
    assert decoded == StemPosition(0.0, 0)
    assert counter == 3


@pytest.mark.parametrize(
    "message",
    [
        *(replace(STATUS, fallback_count=count) for count in (-1, 256)),
        *(StemPosition(value) for value in (math.nan, math.inf, -math.inf, 1.342 + 1e-8, -1.342 - 1e-8)),
        *(StemPosition(0.0, echo) for echo in (-1, 256)),
        *(Setpoint(value) for value in (math.nan, math.inf, -math.inf, 1.342 + 1e-8, -1.342 - 1e-8)),
        *(ActuatorState(value) for value in (math.nan, math.inf, -1.0, 16e6 + 1.0)),
        *(ManualCurrent(value) for value in (math.nan, math.inf, -0.001, 25.001)),
        *(CurrentCommand(value) for value in (math.nan, math.inf, -math.inf, -0.001, 25.001, 1e300)),
        *(PlantTruth(value, 0.0) for value in (math.nan, math.inf, -0.01001, 0.66101)),
        *(PlantTruth(0.0, value) for value in (math.nan, math.inf, -8.192, 8.192)),
    ],
    ids=str,
)
def test_a_value_that_is_not_finite_or_out_of_range_is_not_sent(message: Message) -> None:
    with pytest.raises(EncodingError, match="out of range"):
        CODEC.encode(message, 0)


def test_a_rounding_error_beyond_the_range_is_sent_as_the_limit_and_a_third_of_a_bit_is_not() -> None:
    decoded, _ = CODEC.decode(CODEC.encode(CurrentCommand(25.0002), 0))
    assert decoded == CurrentCommand(25.0, 0, 0)
    with pytest.raises(EncodingError, match=r"CURRENT_COMMAND\.Current_mA: current_ma = 25\.0003"):
        CODEC.encode(CurrentCommand(25.0003), 0)


@pytest.mark.parametrize(
    ("identifier", "data_id", "signal", "reason"),
    [
        (0x110, 0x1F10, (24, 28, 134_200_001), Counted.OUT_OF_RANGE),
        (0x110, 0x1F10, (24, 28, -134_200_001), Counted.OUT_OF_RANGE),
        (0x120, 0x1F20, (24, 28, 134_200_001), Counted.OUT_OF_RANGE),
        (0x111, 0x1F11, (24, 24, 16_000_001), Counted.OUT_OF_RANGE),
        (0x100, 0x1F00, (24, 16, 25_001), Counted.OUT_OF_RANGE),
        (0x170, 0x1F70, (24, 26, 67_100_001), Counted.OUT_OF_RANGE),
        (0x170, 0x1F70, (50, 14, -8192), Counted.OUT_OF_RANGE),
        (0x110, 0x1F10, (60, 4, 4), Counted.UNDEFINED_VALUE),
        (0x120, 0x1F20, (52, 4, 3), Counted.UNDEFINED_VALUE),
        (0x121, 0x1F21, (24, 16, 25_001), Counted.OUT_OF_RANGE),
        (0x121, 0x1F21, (40, 4, 2), Counted.UNDEFINED_VALUE),
        (0x100, 0x1F00, (56, 4, 6), Counted.UNDEFINED_VALUE),
        (0x100, 0x1F00, (60, 4, 4), Counted.UNDEFINED_VALUE),
        (0x140, 0x1F40, (24, 4, 6), Counted.UNDEFINED_VALUE),
        (0x140, 0x1F40, (28, 4, 5), Counted.UNDEFINED_VALUE),
        (0x140, 0x1F40, (32, 6, 26), Counted.UNDEFINED_VALUE),
    ],
)
def test_one_bit_beyond_a_range_or_an_enumeration_is_refused_in_spite_of_its_crc(
    identifier: int, data_id: int, signal: tuple[int, int, int], reason: Counted
) -> None:
    start, length, raw = signal
    assert reason_for(CanFrame(identifier, by_hand(0, data_id, [signal]))) is reason
    one_less = raw - 1 if raw > 0 else raw + 1
    CODEC.decode(CanFrame(identifier, by_hand(0, data_id, [(start, length, one_less)])))


@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: type(message).__name__)
def test_every_single_and_double_bit_error_is_refused(message: Message) -> None:
    frame = CODEC.encode(message, 3)
    word = int.from_bytes(frame.data, "big")
    flips = [1 << bit for bit in range(64)]
    for damage in flips + [one | other for one, other in itertools.combinations(flips, 2)]:
        damaged = replace(frame, data=(word ^ damage).to_bytes(8, "big"))
        assert reason_for(damaged) is Counted.WRONG_CRC


@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: type(message).__name__)
def test_a_frame_under_the_identifier_of_another_message_is_refused(message: Message) -> None:
    frame = CODEC.encode(message, 3)
    for identifier in {0x100, 0x110, 0x111, 0x120, 0x121, 0x140, 0x170} - {frame.arbitration_id}:
        assert reason_for(replace(frame, arbitration_id=identifier)) is Counted.WRONG_CRC


@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: type(message).__name__)
def test_a_frame_of_wrong_length_or_of_one_byte_value_only_is_refused(message: Message) -> None:
    frame = CODEC.encode(message, 3)
    for length in (*range(8), *range(9, 65)):
        assert reason_for(replace(frame, data=frame.data.ljust(64, b"\0")[:length])) is Counted.WRONG_LENGTH
    for byte in (b"\x00", b"\xff"):
        assert reason_for(replace(frame, data=byte * 8)) is Counted.WRONG_CRC


def test_error_remote_and_unknown_frames_are_distinguished() -> None:
    frame = CODEC.encode(Setpoint(0.08), 0)
    assert reason_for(replace(frame, is_error=True)) is Counted.ERROR_FRAME
    assert reason_for(replace(frame, is_remote=True, data=b"")) is Counted.REMOTE_FRAME
    assert reason_for(replace(frame, is_extended=True)) is None
    assert reason_for(replace(frame, arbitration_id=0x7FF)) is None


def test_valves_on_one_bus_never_take_each_others_frames() -> None:
    codecs = [make_codec(WireSettings(id_offset=offset)) for offset in ID_OFFSETS]
    formats = [form for codec in codecs for form in codec.by_kind.values()]
    assert len({form.arbitration_id for form in formats}) == len({form.data_id for form in formats}) == 10 * 9
    assert max(form.arbitration_id for form in formats) <= 0x7FF
    for form in formats:
        assert form.data_id is not None
        assert not p05.e2e_p05_check(bytes(8), form.data_id)


@pytest.mark.parametrize("offset", [-128, 16, 127, 0x500])
def test_an_offset_that_would_mix_up_two_valves_is_refused(offset: int) -> None:
    with pytest.raises(ConfigurationError, match=f"line 1: id_offset = {offset}: must be "):
        parse(f"id_offset = {offset}", WireSettings, "wire.toml")
    with pytest.raises(ConfigurationError, match=f"wire.id_offset = {offset}: must be a multiple of 128 up to 1152"):
        make_codec(WireSettings(id_offset=offset))
