"""A user's DBC: extended identifiers, percent, big-endian, floats, no protection; and every mistake in `[wire]`."""

from __future__ import annotations

import math
import struct
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

import pytest
import tomli_w
from user_dbc import ALL, USER_DBC

from positioner.cli.main import main
from positioner.cycle.events import FramesLost
from positioner.cycle.inbox import receive
from positioner.cycle.link import LinkState
from positioner.errors import ConfigurationError, ExitCode
from positioner.guard.settings import GuardSettings
from positioner.inputs.toml_reader import parse
from positioner.valve.parameters import ValveParameters
from positioner.wire.codec import Codec, make_codec
from positioner.wire.formats import EncodingError, FrameRejectedError
from positioner.wire.messages import (
    ActuatorState,
    CanFrame,
    Cause,
    Counted,
    CurrentCommand,
    Health,
    Mode,
    PositionerCount,
    PositionerStatus,
    Quality,
    Setpoint,
    StemPosition,
)
from positioner.wire.settings import MessageSettings, WireSettings

if TYPE_CHECKING:
    from pathlib import Path

NO_COUNTER = "is signed, scaled or fractional, and a counter needs whole numbers from 0"
TRAVEL_ID = 2566834688 - (1 << 31)


@pytest.fixture
def dbc(tmp_path: Path) -> Path:
    path = tmp_path / "user.dbc"
    path.write_text(USER_DBC, encoding="cp1252")
    return path


@pytest.fixture
def codec(dbc: Path) -> Codec:
    return make_codec(replace(ALL, dbc=dbc), span_m=0.1)


class Near:
    """Equal to the result of `decode` for a message, but for rounding in its numbers."""

    def __init__(self, message: Any, counter: int | None) -> None:
        self.message, self.counter = message, counter

    def __eq__(self, other: object) -> bool:
        assert isinstance(other, tuple)
        message, counter = other
        same = asdict(message) == pytest.approx(asdict(self.message))
        return type(message) is type(self.message) and same and bool(counter == self.counter)

    def __repr__(self) -> str:
        return f"near {self.message}, {self.counter}"

    __hash__ = None  # type: ignore[assignment] # as of everything that is nearly equal


def problems(settings: WireSettings) -> list[str]:
    with pytest.raises(ConfigurationError) as caught:
        make_codec(settings)
    assert caught.value.source == "[wire]"
    return [str(problem) for problem in caught.value.problems]


def rejected(codec: Codec, frame: CanFrame) -> Counted | None:
    with pytest.raises(FrameRejectedError) as caught:
        codec.decode(frame)
    return caught.value.counted


def test_a_big_endian_percent_position_under_an_extended_identifier_is_decoded(codec: Codec) -> None:
    # 60 % of 0.1 m: raw (60 + 10) / 0.01 = 7000, high byte first; the counter in the low nibble of byte 0
    frame = CanFrame(TRAVEL_ID, bytes([0xFD]) + (7000).to_bytes(2, "big") + bytes([1, 0, 0]), is_extended=True)
    assert codec.decode(frame) == Near(StemPosition(0.06, None, Quality.SUSPECT), 13)
    assert rejected(codec, replace(frame, is_extended=False)) is None


def test_ranges_enumerations_and_lengths_of_a_user_are_checked(codec: Codec) -> None:
    def travel(raw: int, health: int = 0, tail: bytes = b"\0\0") -> CanFrame:
        return CanFrame(TRAVEL_ID, b"\0" + raw.to_bytes(2, "big") + bytes([health]) + tail, is_extended=True)

    assert codec.decode(travel(12000)) == Near(StemPosition(0.11), 0)
    assert rejected(codec, travel(12001)) is Counted.OUT_OF_RANGE
    assert rejected(codec, travel(7000, health=4)) is Counted.UNDEFINED_VALUE
    assert rejected(codec, travel(7000, tail=b"\0")) is Counted.WRONG_LENGTH
    assert rejected(codec, travel(7000, tail=b"\0\0\0")) is Counted.WRONG_LENGTH


def test_a_command_in_percent_is_4_to_20_ma_and_spare_signals_have_their_start_value(codec: Codec) -> None:
    frame = codec.encode(CurrentCommand(8.0, 200, 201), 16 + 5)
    assert frame == CanFrame(0x200, (2500).to_bytes(2, "big") + bytes([5, 60]))
    assert codec.decode(frame) == Near(CurrentCommand(8.0), 5)
    assert codec.encode(CurrentCommand(4.0), 0).data[:2] == b"\0\0"
    assert codec.encode(CurrentCommand(20.0), 0).data[:2] == (10000).to_bytes(2, "big")


@pytest.mark.parametrize("current_ma", [3.99, 20.01, math.nan, math.inf])
def test_a_command_outside_the_percent_range_is_not_sent(codec: Codec, current_ma: float) -> None:
    with pytest.raises(EncodingError, match=r"Drive\.Demand: current_ma"):
        codec.encode(CurrentCommand(current_ma), 0)


def test_a_floating_point_signal_is_read_and_one_that_is_not_finite_refused(codec: Codec) -> None:
    assert codec.decode(CanFrame(0x201, struct.pack("<f", 1.5))) == Near(ActuatorState(1.5e5), None)
    for value in (math.nan, math.inf, -math.inf):
        assert rejected(codec, CanFrame(0x201, struct.pack("<f", value))) is Counted.OUT_OF_RANGE
        with pytest.raises(EncodingError):
            codec.encode(ActuatorState(value), 0)
    assert codec.encode(ActuatorState(2e5), 0).data == struct.pack("<f", 2.0)
    with pytest.raises(EncodingError):
        codec.encode(ActuatorState(1e44), 0)


def test_a_signal_with_a_negative_scale_keeps_its_range(codec: Codec) -> None:
    assert codec.encode(Setpoint(0.025), 0).data == struct.pack("<h", -2500)
    for raw in (10000, -10000):
        assert codec.decode(CanFrame(0x202, struct.pack("<h", raw))) == Near(Setpoint(raw * -1e-5), None)
    for raw in (10001, -10001):
        assert rejected(codec, CanFrame(0x202, struct.pack("<h", raw))) is Counted.OUT_OF_RANGE
    for setpoint_m in (0.10001, -0.10001):
        with pytest.raises(EncodingError):
            codec.encode(Setpoint(setpoint_m), 0)


def test_a_counter_wraps_where_its_signal_does(codec: Codec) -> None:
    moduli = {kind.__name__: form.counter_modulus for kind, form in codec.by_kind.items()}
    assert moduli["StemPosition"] == moduli["CurrentCommand"] == 16
    assert moduli["Setpoint"] == moduli["PositionerStatus"] == 256


def test_what_a_user_does_not_name_stays_ours(dbc: Path) -> None:
    codec = make_codec(WireSettings(dbc=dbc, id_offset=0x80, setpoint=ALL.setpoint))
    ours = codec.encode(StemPosition(0.05, 7), 3)
    assert ours.arbitration_id == 0x190
    assert codec.decode(ours) == Near(StemPosition(0.05, 7), 3)
    assert codec.encode(Setpoint(0.025), 0).arbitration_id == 0x202
    assert rejected(codec, replace(ours, arbitration_id=0x1A0)) is None


@pytest.mark.parametrize("encoding", ["utf-8", "cp1252"])
def test_a_unit_beyond_ascii_is_read_in_both_encodings(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "micro.dbc"
    path.write_text(USER_DBC.replace('"mm"', '"µm"'), encoding=encoding)
    codec = make_codec(WireSettings(dbc=path, setpoint=ALL.setpoint))
    assert codec.encode(Setpoint(25e-6), 0).data == struct.pack("<h", -2500)


def test_the_wire_table_of_a_settings_file_is_read() -> None:
    text = """
        dbc = "user.dbc"
        [stem_position]
        message = "Travel"
        signals = { position_m = "Travel", quality = "Health" }
        counter = "Alive"
    """
    settings = parse(text, WireSettings, "wire.toml")
    assert settings.stem_position == ALL.stem_position


def test_a_message_without_a_dbc_is_reported() -> None:
    assert problems(WireSettings(setpoint=ALL.setpoint)) == [
        "wire.dbc: is missing: name the DBC file that holds your messages"
    ]


def test_a_dbc_that_is_not_there_is_named(tmp_path: Path) -> None:
    path = tmp_path / "gone.dbc"
    assert problems(WireSettings(dbc=path, setpoint=ALL.setpoint)) == [
        f"wire.dbc = '{path}': cannot be read: No such file or directory"
    ]
    assert problems(WireSettings(dbc=tmp_path))[0].endswith("cannot be read: Is a directory")


OUTSIDE_ITS_FRAME = b'VERSION ""\nBU_: X\nBO_ 1 A: 1 X\n SG_ S : 0|16@1+ (1,0) [0|1] "" X\n'


@pytest.mark.parametrize("content", [b"mass_kg = 1361\n", b"\x81\x8d\x00", OUTSIDE_ITS_FRAME])
def test_a_file_that_is_no_dbc_is_reported(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "other.dbc"
    path.write_bytes(content)
    (problem,) = problems(WireSettings(dbc=path, setpoint=ALL.setpoint))
    assert problem.startswith(f"wire.dbc = '{path}': is no DBC: ")


def test_a_dbc_without_messages_is_reported(tmp_path: Path) -> None:
    path = tmp_path / "empty.dbc"
    path.write_text('VERSION ""\n', encoding="cp1252")
    assert problems(WireSettings(dbc=path, setpoint=ALL.setpoint)) == [f"wire.dbc = '{path}': holds no message"]


def test_two_messages_under_one_identifier_are_refused_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "own.dbc"
    path.write_text(USER_DBC + '\nBO_ 512 Impostor: 4 PLC\n SG_ X : 0|8@1+ (1,0) [0|0] "" VALVE\n', "utf-8")
    told = "gives the identifier 200 to Drive and to Impostor: a frame holds one message; keep the right one of them"
    for settings in (replace(ALL, dbc=path), WireSettings(dbc=path)):
        assert problems(settings) == [f"wire.dbc = '{path}': {told}"]


def test_every_mistake_in_the_wire_table_has_its_line_at_once(dbc: Path) -> None:
    settings = WireSettings(
        dbc=dbc,
        stem_position=MessageSettings(
            message="Travel", signals={"position_m": "Temperature", "qualty": "Health", "quality": "Travel"}
        ),
        actuator_state=MessageSettings(message="Presure", signals={"pressure_pa": "Supply"}),
        setpoint=MessageSettings(message="Tail", signals={"request": "Missing"}, counter="Scaled"),
        current_command=MessageSettings(message="Drive", signals={"current_ma": "Demand"}, counter="Alife"),
    )
    names = "Travel, Drive, Pressure, Target, Wide, Mixed, Tail"
    expected = [
        "wire.stem_position.signals.position_m = 'Temperature': has the unit 'degC', which does not fit position_m",
        "wire.stem_position.signals.qualty = 'Health': no such field; known: position_m, command_counter, quality",
        "wire.stem_position.signals.quality = 'Travel': is scaled or fractional, and quality needs whole numbers",
        f"wire.actuator_state.message = 'Presure': is not in the DBC, which has: {names}",
        "wire.setpoint.signals: setpoint_m is required and missing",
        f"wire.setpoint.counter = 'Scaled': {NO_COUNTER}",
        "wire.setpoint.signals.request = 'Missing': is not in Tail, which has: Target, Signed, Scaled",
        "wire.current_command.counter = 'Alife': is not in Drive, which has: Demand, Alive, Spare",
    ]
    assert sorted(_with_sorted_names(problem) for problem in problems(settings)) == sorted(
        _with_sorted_names(problem) for problem in expected
    )


def _with_sorted_names(problem: str) -> str:
    """Return the problem with its list of names sorted: cantools sorts messages and signals its own way."""
    head, separator, names = problem.partition("which has: ")
    return head + separator + ", ".join(sorted(names.split(", ")))


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        (
            WireSettings(stem_position=MessageSettings(message="Wide", signals={"position_m": "Travel"})),
            "wire.stem_position.message: Wide is longer than the 8 bytes of classic CAN",
        ),
        (
            WireSettings(stem_position=MessageSettings(message="Mixed", signals={"position_m": "Travel"})),
            "wire.stem_position.message: Mixed is multiplexed, which is not supported",
        ),
        (
            WireSettings(setpoint=MessageSettings(message="Tail", signals={"setpoint_m": "Target"}, counter="Signed")),
            f"wire.setpoint.counter = 'Signed': {NO_COUNTER}",
        ),
        (
            WireSettings(actuator_state=MessageSettings(message="Drive", signals={"pressure_pa": "Demand"})),
            "wire.actuator_state.signals.pressure_pa = 'Demand': has the unit '%', which does not fit pressure_pa",
        ),
    ],
)
def test_a_frame_that_cannot_carry_the_message_is_reported(dbc: Path, settings: WireSettings, expected: str) -> None:
    assert problems(replace(settings, dbc=dbc)) == [expected]


def test_two_messages_in_one_frame_of_the_user_are_reported(dbc: Path) -> None:
    tail = MessageSettings(message="Tail", signals={"setpoint_m": "Target"})
    also = MessageSettings(message="Tail", signals={"position_m": "Target"})
    assert problems(WireSettings(dbc=dbc, setpoint=tail, stem_position=also)) == [
        "wire.dbc: Tail and Tail share the identifier 205"
    ]


def test_a_dbc_of_more_than_a_mebibyte_is_refused_before_it_is_parsed(tmp_path: Path) -> None:
    path = tmp_path / "large.dbc"
    path.write_bytes(b'CM_ "' + b"x" * (1 << 20) + b'";\n')
    assert problems(replace(ALL, dbc=path))[0].endswith(
        "is larger than 1 MiB: keep only the messages of this valve's nodes in it"
    )


# identifiers of other messages, counters that end before their bits do, and signals that carry no number

CLASHES = """BO_ 256 Lamp: 2 PLC
 SG_ On : 0|1@1+ (1,0) [0|1] "" VALVE

BO_ 320 Horn: 2 PLC
 SG_ On : 0|1@1+ (1,0) [0|1] "" VALVE

BO_ 321 Bell: 2 PLC
 SG_ On : 0|1@1+ (1,0) [0|1] "" VALVE

BO_ 368 Gong: 2 PLC
 SG_ On : 0|1@1+ (1,0) [0|1] "" VALVE

BA_DEF_ SG_"""


@pytest.fixture
def crowded(tmp_path: Path) -> Path:
    path = tmp_path / "crowded.dbc"
    path.write_text(USER_DBC.replace("BA_DEF_ SG_", CLASHES), encoding="cp1252")
    return path


def test_an_identifier_that_the_dbc_gives_to_another_message_is_refused_at_the_start(crowded: Path) -> None:
    how = "= 0x7F0, for example, or move all of ours with wire.id_offset"
    named = replace(ALL, dbc=crowded)
    assert problems(named) == [
        f"wire.dbc: gives the identifier {identifier} of our {ours} to {theirs}: "
        f"give ours another with wire.identifiers.{ours.lower()} {how}"
        for identifier, ours, theirs in (("140", "POSITIONER_STATUS", "Horn"), ("141", "POSITIONER_COUNT", "Bell"))
    ]
    with_our_command = replace(named, current_command=None)
    assert problems(with_our_command)[0].startswith("wire.dbc: gives the identifier 100 of our CURRENT_COMMAND to Lamp")


def test_the_user_names_identifiers_for_our_frames_or_moves_them_all(crowded: Path) -> None:
    chosen = {"positioner_status": 0x345, "positioner_count": 0x346}
    codec = make_codec(replace(ALL, dbc=crowded, identifiers=chosen))
    assert [codec.identifier(kind) for kind in (PositionerStatus, PositionerCount)] == [(0x345, False), (0x346, False)]
    status = PositionerStatus(Mode.READY, Cause.DISARMED, Health.GOOD, False, True, 1, 2, 3)
    assert codec.decode(codec.encode(status, 7)) == (status, 7)
    moved = make_codec(replace(ALL, dbc=crowded, id_offset=0x80))
    assert moved.identifier(PositionerStatus) == (0x1C0, False)


def test_our_own_messages_inside_the_users_dbc_are_no_clash(tmp_path: Path) -> None:
    path = tmp_path / "both.dbc"
    ours = 'BO_ 320 POSITIONER_STATUS: 8 PLC\n SG_ Mode : 24|4@1+ (1,0) [0|15] "" VALVE\n\n'
    path.write_text(USER_DBC.replace("BA_DEF_ SG_", f"{ours}BA_DEF_ SG_"), encoding="cp1252")
    assert make_codec(replace(ALL, dbc=path)).identifier(PositionerStatus) == (0x140, False)


def test_a_named_identifier_must_be_free_and_of_a_frame_of_ours(dbc: Path) -> None:
    chosen = {"positioner_statsu": 0x345, "setpoint": 0x346, "positioner_count": 0x110, "stem_position": 0x110}
    lines = problems(WireSettings(dbc=dbc, setpoint=ALL.setpoint, identifiers=chosen))
    assert lines[0].startswith("wire.identifiers.positioner_statsu = 0x345: is no frame of ours")
    assert "positioner_status" in lines[0]
    assert lines[1:] == [
        "wire.identifiers.setpoint = 0x346: wire.setpoint names a message of your own, whose identifier the DBC gives",
        "wire.dbc: STEM_POSITION and POSITIONER_COUNT share the identifier 110",
    ]
    with pytest.raises(
        ConfigurationError, match=r"identifiers\.stem_position = 2048: must be less than or equal to 2047"
    ):
        parse("identifiers = { stem_position = 2048 }", WireSettings, "wire.toml")


def changed(dbc: Path, old: str, new: str) -> Path:
    text = dbc.read_text(encoding="cp1252")
    assert old in text
    path = dbc.with_name("changed.dbc")
    path.write_text(text.replace(old, new), encoding="cp1252")
    return path


def test_a_counter_wraps_where_its_range_ends(dbc: Path) -> None:
    path = changed(dbc, "SG_ Alive : 16|4@1+ (1,0) [0|15]", "SG_ Alive : 16|4@1+ (1,0) [0|14]")
    path = changed(path, "SG_ Alive : 3|4@0+ (1,0) [0|15]", "SG_ Alive : 3|4@0+ (1,0) [0|14]")
    codec = make_codec(replace(ALL, dbc=path), span_m=0.1)
    sent = [codec.encode(CurrentCommand(12.0), counter).data[2] & 0x0F for counter in range(31)]
    assert sent == [*range(15), *range(15), 0]
    readings = [codec.encode(StemPosition(0.05), counter) for counter in range(60)]
    link, lost, taken = LinkState(), 0, 0
    for frame in readings:
        received = receive(codec, GuardSettings(), ValveParameters(id="x"), link, (frame,))
        link, taken = received.link, taken + (received.reading is not None)
        lost += sum(isinstance(event, FramesLost) for event in received.events)
    assert (lost, taken) == (0, 60)
    invalid = replace(readings[0], data=bytes([readings[0].data[0] & 0xF0 | 0x0F, *readings[0].data[1:]]))
    assert rejected(codec, invalid) is Counted.OUT_OF_RANGE


TRAVEL, SUPPLY = "Travel : 15|16@0+ (0.01,-10) [-10|110]", "Supply : 0|32@1-"
ALIVE = "SG_ Alive : 16|4@1+ (1,0) [0|15]"
POSITION_KEY = "wire.stem_position.signals.position_m = 'Travel'"
NO_NUMBER = "which is no number that a signal can have"
COUNTER_KEY = "wire.current_command.counter = 'Alive'"


def test_a_message_that_stands_twice_in_the_dbc_is_refused(dbc: Path) -> None:
    twice = changed(dbc, "BO_ 515 Wide: 16 VALVE", "BO_ 515 Target: 8 VALVE")
    assert problems(replace(ALL, dbc=twice)) == [
        "wire.setpoint.message = 'Target': occurs 2 times in the DBC: keep one"
    ]


@pytest.mark.parametrize(
    ("old", "new", "key", "message"),
    [
        (
            TRAVEL,
            "Travel : 15|16@0+ (0,-10) [0|0]",
            POSITION_KEY,
            "has the scale 0, which carries no number",
        ),
        (
            TRAVEL,
            "Travel : 15|16@0+ (0.01,-10) [800|900]",
            POSITION_KEY,
            "has the range 800 to 900, which holds no value",
        ),
        (
            SUPPLY,
            "Supply : 0|24@1-",
            "wire.actuator_state.signals.pressure_pa = 'Supply'",
            "is a floating-point signal of 24 bits, and there are 16, 32 and 64",
        ),
        (
            ALIVE,
            ALIVE.replace("[0|", "[1|"),
            COUNTER_KEY,
            "has the range 1 to 15, and a counter needs one from 0 to 3 at least",
        ),
        (
            ALIVE,
            "SG_ Alive : 16|1@1+ (1,0) [0|1]",
            COUNTER_KEY,
            "has the range 0 to 1, and a counter needs one from 0 to 3 at least",
        ),
        (ALIVE, ALIVE.replace("(1,", "(0,"), COUNTER_KEY, NO_COUNTER),
        *(
            (TRAVEL, TRAVEL.replace(old, new), POSITION_KEY, f"has the {name} {message}, {NO_NUMBER}")
            for old, new, name, message in (
                ("(0.01", f"(1{'0' * 400}", "scale", "1" + "0" * 400),
                ("-10)", "1e999)", "offset", "inf"),
                ("[-10", f"[-1{'0' * 400}", "minimum", "-1" + "0" * 400),
            )
        ),
        (ALIVE, ALIVE.replace("15]", "-1e999]"), COUNTER_KEY, f"has the maximum -inf, {NO_NUMBER}"),
    ],
)
def test_a_signal_that_carries_no_number_is_one_line_at_the_check_and_at_the_start(
    dbc: Path, old: str, new: str, key: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = changed(dbc, old, new)
    assert problems(replace(ALL, dbc=path)) == [f"{key}: {message}"]
    config = dbc.with_name("valve.toml")
    named = ("stem_position", "actuator_state", "setpoint", "current_command")
    wire: dict[str, Any] = {"dbc": "changed.dbc"}
    for name in named:
        wire[name] = {each: value for each, value in asdict(getattr(ALL, name)).items() if value}
    config.write_text(tomli_w.dumps({"valve": {"id": "x", "preset": "paper"}, "wire": wire}), encoding="utf-8")
    for command in (["check", str(config)], ["run", "--config", str(config), "--state", str(dbc.parent)]):
        assert main(command) == ExitCode.CONFIG
        (line,) = capsys.readouterr().err.splitlines()
        assert message in line


def test_whatever_numbers_a_dbc_gives_a_signal_end_in_a_codec_or_in_a_line(dbc: Path) -> None:
    refused = []
    for scale in ("0", "-0", "1e-320", "1e308", "nan", "inf", "-1"):
        for length in (1, 8, 24, 32, 64):
            for extra in ("[0|0]", "[5|-5]", "[nan|nan]", "[1e308|1e309]"):
                text = f"SG_ Supply : 0|{min(length, 32)}@1- ({scale},0) {extra}"
                path = changed(dbc, "SG_ Supply : 0|32@1- (1,0) [0|0]", text)
                try:
                    assert make_codec(replace(ALL, dbc=path)).by_kind
                except ConfigurationError as error:
                    refused.append(str(error))
    assert 0 < len(refused) < 7 * 5 * 4
    assert not any("\n" in line for line in refused)
