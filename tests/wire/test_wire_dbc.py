"""Our DBC as a document: units, layout, attributes, value tables, and that other tools can read it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import cantools.database
import pytest
from cantools.database.can import Database

from positioner.wire.codec import make_codec, packaged_dbc_text
from positioner.wire.messages import (
    Cause,
    Counted,
    Health,
    HostRequest,
    ManualRequest,
    Mode,
    Motion,
    Quality,
    StemPosition,
)

if TYPE_CHECKING:
    from enum import IntEnum

    from cantools.database.can.message import Message as DbcMessage

DBC = Path(__file__).parents[2] / "dbc" / "positioner.dbc"


def _read() -> Database:
    # not strict: the tests here check whether signals overlap
    database = cantools.database.load_string(DBC.read_text(encoding="utf-8"), "dbc", strict=False)
    assert isinstance(database, Database)
    return database


MESSAGES = _read().messages
BY_NAME = {message.name: message for message in MESSAGES}
SI_OF_UNIT = {"mm": ("m", 1e-3), "mm/s": ("m_per_s", 1e-3), "mA": ("ma", 1.0), "kPa": ("pa", 1e3)}
SUFFIX_IN_DBC = {"mm": "_mm", "mm/s": "_mm_per_s", "mA": "_mA", "kPa": "_kPa"}


def attribute(message: DbcMessage, name: str) -> float | str:
    """Return an attribute that the message sets itself: a default does not count."""
    assert message.dbc is not None
    value: float | str = message.dbc.attributes[name].value
    return value


def test_the_packaged_text_is_this_file() -> None:
    assert packaged_dbc_text() == DBC.read_text(encoding="utf-8")


def test_the_dbc_holds_the_nine_messages_under_their_identifiers() -> None:
    assert {message.name: message.frame_id for message in MESSAGES} == {
        "CURRENT_COMMAND": 0x100,
        "STEM_POSITION": 0x110,
        "ACTUATOR_STATE": 0x111,
        "SETPOINT": 0x120,
        "MANUAL_CURRENT": 0x121,
        "POSITIONER_STATUS": 0x140,
        "POSITIONER_COUNT": 0x141,
        "POSITIONER_ALARMS": 0x142,
        "PLANT_TRUTH": 0x170,
    }
    assert not any(message.is_extended_frame for message in MESSAGES)
    assert {message.length for message in MESSAGES} == {8}


@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: message.name)
def test_signals_never_overlap_and_lie_within_64_bits(message: DbcMessage) -> None:
    assert all(signal.byte_order == "little_endian" for signal in message.signals)
    bits = [signal.start + offset for signal in message.signals for offset in range(signal.length)]
    assert len(bits) == len(set(bits))
    assert min(bits) == 0
    assert max(bits) <= 63


@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: message.name)
def test_the_crc_and_the_counter_stand_where_profile_5_wants_them(message: DbcMessage) -> None:
    layout = {signal.name: (signal.start, signal.length) for signal in message.signals}
    assert layout["Crc"] == (0, 16)
    assert layout["Counter"] == (16, 8)
    assert attribute(message, "E2eProfile") == "P05"


def test_data_ids_are_attributes_and_unique() -> None:
    data_ids = {attribute(message, "E2eDataId") for message in MESSAGES}
    assert len(data_ids) == len(MESSAGES)
    assert 0 not in data_ids


def test_cycle_times_in_ms_are_attributes() -> None:
    assert {message.name: attribute(message, "GenMsgCycleTime") for message in MESSAGES} == {
        "CURRENT_COMMAND": 1,
        "STEM_POSITION": 1,
        "ACTUATOR_STATE": 10,
        "SETPOINT": 10,
        "MANUAL_CURRENT": 50,
        "POSITIONER_STATUS": 100,
        "POSITIONER_COUNT": 100,
        "POSITIONER_ALARMS": 100,
        "PLANT_TRUTH": 1,
    }


@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: message.name)
def test_the_unit_of_a_signal_is_the_suffix_of_its_name(message: DbcMessage) -> None:
    for signal in message.signals:
        suffixes = [suffix for suffix in SUFFIX_IN_DBC.values() if signal.name.endswith(suffix)]
        assert suffixes == ([SUFFIX_IN_DBC[signal.unit]] if signal.unit else []), signal.name


def test_the_unit_of_a_signal_fits_the_suffix_of_its_field_and_is_scaled_to_si() -> None:
    physical = 0
    for form in make_codec().by_kind.values():
        for field in form.fields:
            signal = BY_NAME[form.dbc.name].get_signal_by_name(field.signal)
            if signal.unit:
                suffix, factor = SI_OF_UNIT[signal.unit]
                # the longest suffix decides: a speed in _m_per_s ends in no _m
                assert field.name.endswith(f"_{suffix}")
                assert field.si_per_bit == pytest.approx(signal.scale * factor, rel=1e-12)
                physical += 1
            else:
                assert not field.name.endswith(("_m", "_m_per_s", "_ma", "_pa"))
                assert field.si_per_bit == 1
    assert physical == 7


def test_every_signal_but_the_crc_and_the_counter_is_a_field() -> None:
    for form in make_codec().by_kind.values():
        named = [field.signal for field in form.fields]
        assert sorted([*named, "Crc", "Counter"]) == sorted(signal.name for signal in form.dbc.signals)


def test_the_current_is_sent_to_1_ua_and_the_position_to_10_nm() -> None:
    fields = {(form.dbc.name, field.name): field for form in make_codec().by_kind.values() for field in form.fields}
    assert fields["CURRENT_COMMAND", "current_ma"].si_per_bit <= 1e-3 * (1.0 + 1e-12)
    for key in (("STEM_POSITION", "position_m"), ("SETPOINT", "setpoint_m"), ("PLANT_TRUTH", "position_m")):
        assert fields[key].si_per_bit <= 10e-9 * (1.0 + 1e-12)


def test_every_value_table_is_its_enumeration() -> None:
    expected: dict[tuple[str, str], type[IntEnum]] = {
        ("STEM_POSITION", "Quality"): Quality,
        ("CURRENT_COMMAND", "Mode"): Mode,
        ("CURRENT_COMMAND", "Motion"): Motion,
        ("SETPOINT", "Request"): HostRequest,
        ("MANUAL_CURRENT", "Request"): ManualRequest,
        ("POSITIONER_STATUS", "Mode"): Mode,
        ("POSITIONER_STATUS", "Health"): Health,
        ("POSITIONER_STATUS", "Cause"): Cause,
        ("POSITIONER_COUNT", "Counted"): Counted,
        ("POSITIONER_ALARMS", "Worst"): Health,
    }
    tables = {
        (message.name, signal.name): {number: str(name) for number, name in signal.choices.items()}
        for message in MESSAGES
        for signal in message.signals
        if signal.choices
    }
    names = {key: {member.value: member.name for member in kind} for key, kind in expected.items()}
    assert tables == names


@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: message.name)
def test_every_message_has_a_sender_a_receiver_and_a_comment(message: DbcMessage) -> None:
    assert message.senders
    assert message.receivers
    assert message.comment


def test_cantools_decodes_a_line_of_candump() -> None:
    frame = make_codec().encode(StemPosition(0.0834567, 200, Quality.SUSPECT), 5)
    line = f"  vcan0  {frame.arbitration_id:03X}   [8]  {frame.data.hex(' ').upper()}\n"
    done = subprocess.run(
        [sys.executable, "-m", "cantools", "decode", str(DBC)],
        input=line,
        capture_output=True,
        text=True,
        timeout=300,
        check=True,
    )
    assert "STEM_POSITION(" in done.stdout
    assert "Position_mm: 83.4567" in done.stdout
    assert "CommandCounter: 200" in done.stdout
    assert "Quality: SUSPECT" in done.stdout
    assert "Counter: 5" in done.stdout
