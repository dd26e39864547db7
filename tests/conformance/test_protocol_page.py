"""docs/protocol.md says what the code does: identifiers, CRC, counters, test vectors, arming, times."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from plant_emulator.device import initial_device, publish, take
from plant_emulator.presets import plant_settings
from positioner.cycle.inbox import receive
from positioner.cycle.link import LinkState
from positioner.guard.settings import GuardSettings
from positioner.guard.state import GuardState
from positioner.guard.supervisor import supervise
from positioner.laws.settings import ControlSettings
from positioner.valve.parameters import ValveParameters
from positioner.wire import e2e
from positioner.wire.codec import make_codec, own_database
from positioner.wire.messages import CanFrame, CurrentCommand, HostRequest, Setpoint, StemPosition
from positioner.wire.settings import ID_OFFSETS, WireSettings
from positioner.wire.window import CLEAN_FRAMES, MAX_ERRORS, WINDOW_FRAMES

PAGE = (Path(__file__).parents[2] / "docs" / "protocol.md").read_text(encoding="utf-8")
CODEC = make_codec()
VALVE = ValveParameters(id="paper")
SETTINGS = GuardSettings()
MS = 1_000_000


def table(head: str) -> list[list[str]]:
    """Return the rows of the page's table whose first row begins with `head`, without the marks of code."""
    _, _, after = PAGE.partition(f"\n| {head} |")
    rows = after.partition("\n\n")[0].splitlines()[2:]
    assert rows, head
    return [[cell.strip().replace("`", "") for cell in row.strip("| ").split(" | ")] for row in rows]


def test_the_page_lists_every_message_with_its_identifier_and_data_id() -> None:
    said = {
        (name, int(identifier, 16), int(data_id, 16)) for name, identifier, data_id, *_ in table("message | identifier")
    }
    real = {
        (message.name, message.frame_id, int(message.dbc.attributes["E2eDataId"].value))
        for message in own_database().messages
        if message.dbc
    }
    assert said == real
    found = re.search(r"a multiple of (\d+) up to (\d+)", PAGE)
    assert found
    assert (int(found[1]), int(found[2])) == (ID_OFFSETS.step, ID_OFFSETS[-1])


def test_the_pages_crc_is_ours() -> None:
    code = PAGE.partition("```python\n")[2].partition("```")[0]
    names: dict[str, Any] = {}
    exec(code, names)  # noqa: S102 - our own page
    for covered in (bytes(6), bytes(range(6)), b"\xff" * 6):
        for data_id in (0, 0x1F10, 0xFFFF):
            assert names["crc"](covered, data_id) == e2e.crc(covered, data_id)
    check = re.search(r"`(\d+)` is ([0-9A-F]{4})\)", PAGE)
    assert check
    digits = check[1].encode("ascii")
    assert names["crc"](digits[:-2], int.from_bytes(digits[-2:], "little")) == int(check[2], 16)


@pytest.mark.parametrize("row", table("message | `id_offset`"), ids=lambda row: f"{row[0]}-{row[2]}")
def test_each_test_vector_is_what_the_code_sends_and_takes(row: list[str]) -> None:
    name, id_offset, counter, signals, identifier, data = row
    codec = make_codec(WireSettings(id_offset=int(id_offset)))
    frame = CanFrame(int(identifier, 16), bytes.fromhex(data))
    message, received = codec.decode(frame)
    assert received == int(counter)
    assert codec.encode(message, int(counter)) == frame
    form = codec.by_kind[type(message)]
    assert form.dbc.name == name
    decoded: dict[str, Any] = form.dbc.decode(frame.data)  # type: ignore[assignment]
    said = dict(pair.split(" = ") for pair in signals.split(", "))
    assert list(said) == [signal for signal in decoded if signal not in {"Crc", "Counter"}]
    for signal, value in said.items():
        assert str(decoded[signal]) == value or decoded[signal] == pytest.approx(float(value), abs=1e-9)


def setpoints_accepted(counters: list[int]) -> list[int]:
    link, taken = LinkState(), []
    for counter in counters:
        frame = CODEC.encode(Setpoint(0.08), counter)
        received = receive(CODEC, SETTINGS, VALVE, link, (frame,))
        link = received.link
        taken += [counter] if received.guard_input.setpoint_age_ns is not None else []
    return taken


def readings_accepted(counters: list[int]) -> list[int]:
    link, taken = LinkState(), []
    for counter in counters:
        frame = CODEC.encode(StemPosition(0.08), counter)
        received = receive(CODEC, SETTINGS, VALVE, link, (frame,))
        link = received.link
        taken += [received.reading.counter] if received.reading else []
    return [counter for counter in taken if counter is not None]


def commands_accepted(counters: list[int]) -> list[int]:
    plant = plant_settings("paper")
    state, taken = initial_device(plant, 1), []
    for index, counter in enumerate(counters):
        current_ma = 5.0 + index  # its own: what is in force afterwards tells whether it was obeyed
        state = take(CODEC, state, (CODEC.encode(CurrentCommand(current_ma), counter),))
        if state.current_ma == current_ma:
            taken.append(counter)
        _, frames = publish(CODEC, plant, state)
        reading = CODEC.decode(frames[-1])[0]
        assert isinstance(reading, StemPosition)
        assert reading.command_counter == taken[-1]
    return taken


@pytest.mark.parametrize("row", table("counters, in order"), ids=lambda row: row[0])
def test_the_counters_of_the_page_are_taken_and_refused_as_it_says(row: list[str]) -> None:
    sent, accepted = ([int(number) for number in cell.split()] for cell in row[:2])
    assert commands_accepted(sent) == accepted
    assert setpoints_accepted(sent) == accepted
    restarted = sent == [5, 17, 18, 19]
    assert readings_accepted(sent) == ([5, 19] if restarted else accepted)


def test_two_senders_are_disputed_after_as_many_frames_as_the_page_says() -> None:
    found = re.search(r"More than (\w+) frames out of sequence among (\d+) .* until (\d+) come", PAGE, re.DOTALL)
    assert found
    assert (found[1], int(found[2]), int(found[3])) == ({3: "three"}[MAX_ERRORS], WINDOW_FRAMES, CLEAN_FRAMES)


@pytest.mark.parametrize("row", table("requests, in order"), ids=lambda row: row[0])
def test_the_requests_of_the_page_arm_or_do_not_as_it_says(row: list[str]) -> None:
    requests = [HostRequest[name] for name in row[0].split()]
    setpoints = [CODEC.encode(Setpoint(0.08, request), counter) for counter, request in enumerate(requests)]
    link, guard = LinkState(), GuardState()
    received = receive(CODEC, SETTINGS, VALVE, link, (CODEC.encode(StemPosition(0.08), 0), *setpoints))
    guard = supervise(SETTINGS, guard, received.guard_input, 0.001, 1000 * MS)
    assert guard.arming.armed is (row[1] == "yes")
    assert guard.transmits is guard.arming.armed


def test_the_times_of_the_page_are_the_defaults() -> None:
    holders = {"guard": SETTINGS, "control": ControlSettings(), "": plant_settings("paper")}
    for name, default, _ in table("setting"):
        owner, _, field = name.rpartition(".")
        assert getattr(holders[owner], field) == float(default), name
