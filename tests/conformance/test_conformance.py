"""Each rule of a conformance test catches the node that breaks it, and a correct node breaks none."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from typing import TYPE_CHECKING

import conformance_hosts
import conformance_plants
import pytest
from conformance_hosts import Host
from conformance_plants import CODEC, DEADMAN_S, OFFSET, Plant

from positioner.conformance.crc_mistakes import mistake
from positioner.conformance.host import HOST_RULES, HostLimits, HostTest
from positioner.conformance.plant import PLANT_RULES, PlantLimits, PlantTest
from positioner.conformance.report import as_values, blocks
from positioner.conformance.rules import RuleResult, Verdict, conforms
from positioner.conformance.script import Script
from positioner.report.table import Table
from positioner.wire import e2e
from positioner.wire.codec import own_database
from positioner.wire.messages import CanFrame, CurrentCommand, Health, PositionerAlarms, Setpoint, StemPosition

if TYPE_CHECKING:
    from collections.abc import Iterable

    from positioner.wire.messages import Message

NS = 1_000_000_000
START_NS = 5 * NS
UNREADABLE = {"received", "format", "crc", "values"}
LIMITS = PlantLimits(period_s=conformance_plants.PERIOD_S, deadman_s=DEADMAN_S, travel_m=(-0.01, 0.15))


def plant_results(plant: Plant, currents_ma: tuple[float, float] | None = (8.0, 9.0)) -> tuple[RuleResult, ...]:
    script = Script(CODEC, currents_ma, DEADMAN_S, LIMITS.settle_s, 0.5)
    test = PlantTest(CODEC, LIMITS, script, OFFSET)
    now_ns = START_NS
    sent: list[CanFrame] = []
    while test.goes_on(now_ns):
        for frame in plant.cycle():
            answer = test.receive(replace(frame, received_ns=now_ns), now_ns)
            if answer is not None:
                sent.append(answer)
                plant.take(answer)
        now_ns += round(plant.period_s * NS)
    assert (now_ns - START_NS) / NS == pytest.approx(script.duration_s, abs=0.5)
    for frame in sent:
        command = own_database().get_message_by_name("CURRENT_COMMAND").decode(frame.data.ljust(8, b"\0"))
        assert isinstance(command, dict)
        assert 8.0 <= float(str(command["Current_mA"])) <= 9.0 or command["Current_mA"] == 3.6
    assert bool(sent) is (currents_ma is not None and plant.rule not in UNREADABLE)
    return test.results(now_ns)


def host_results(host: Host) -> tuple[RuleResult, ...]:
    test = HostTest(CODEC, HostLimits(travel_m=(0.0, 0.127)), 10.0, OFFSET)
    now_ns = START_NS
    while test.goes_on(now_ns):
        for frame in host.cycle():
            test.receive(replace(frame, received_ns=now_ns), now_ns)
        now_ns += round(conformance_hosts.PERIOD_S * NS)
    return test.results(now_ns)


def broken(results: Iterable[RuleResult]) -> set[str]:
    return {result.rule.name for result in results if result.verdict is Verdict.FAIL}


def test_the_emulator_keeps_every_rule_of_a_plant() -> None:
    results = plant_results(Plant())
    assert [result.rule for result in results] == list(PLANT_RULES)
    assert {result.verdict for result in results} == {Verdict.PASS}, broken(results)
    assert conforms(results)


def test_a_correct_host_keeps_every_rule_of_a_host() -> None:
    results = host_results(Host())
    assert [result.rule for result in results] == list(HOST_RULES)
    assert {result.verdict for result in results} == {Verdict.PASS}, broken(results)


def test_without_currents_nothing_is_sent_to_the_plant_and_its_obedience_is_not_seen() -> None:
    results = plant_results(Plant(), None)
    assert [result.rule.name for result in results if result.verdict is not Verdict.PASS] == [
        "echo", "obeys", "repeat", "damage", "old", "short", "deadman", "grace", "rejoins", "restart",
        "failure-signal",
    ]  # fmt: skip
    assert conforms(results)


@pytest.mark.parametrize("faulty", Plant.__subclasses__(), ids=lambda each: each.__name__)
def test_each_faulty_plant_is_caught_by_its_rule(faulty: type[Plant]) -> None:
    results = plant_results(faulty())
    assert faulty.rule in broken(results)
    assert all(result.fix for result in results if result.verdict is Verdict.FAIL)


@pytest.mark.parametrize("faulty", Host.__subclasses__(), ids=lambda each: each.__name__)
def test_each_faulty_host_is_caught_by_its_rule(faulty: type[Host]) -> None:
    results = host_results(faulty())
    assert faulty.rule in broken(results)
    assert all(result.fix for result in results if result.verdict is Verdict.FAIL)


def test_a_positioner_beside_the_host_breaks_no_rule_of_it() -> None:
    test = HostTest(CODEC, HostLimits(), 10.0, OFFSET)
    test.goes_on(START_NS)
    alarms, command = PositionerAlarms(Health.FAILURE, 1, 1, 1), CurrentCommand(12.0, 0)
    messages: tuple[Message, ...] = (alarms, command, Setpoint(0.05))
    for number, message in enumerate(messages):
        test.receive(CODEC.encode(message, number), START_NS)
    (found,) = (result for result in test.results(START_NS) if result.rule.name == "identifiers")
    assert found.verdict is Verdict.PASS


def test_every_rule_has_a_node_that_breaks_it() -> None:
    assert {each.rule for each in Plant.__subclasses__()} == {rule.name for rule in PLANT_RULES}
    assert {each.rule for each in Host.__subclasses__()} == {rule.name for rule in HOST_RULES}


@pytest.mark.parametrize(
    ("faulty", "alone"),
    [
        (conformance_plants.IsTooSlow, {"period"}),
        (conformance_plants.MeasuresInAnotherUnit, {"travel"}),
        (conformance_plants.CallsItselfValidBeforeAnyCommand, {"first"}),
        (conformance_plants.LivesOnRepeatedCommands, {"repeat"}),
        (conformance_plants.ChecksNoCrc, {"damage"}),
        (conformance_plants.HasAMessageUnderAnIdentifierOfThePositioner, {"identifiers"}),
        (conformance_plants.TakesShortFrames, {"short"}),
        (conformance_plants.NeverObeysARestartedController, {"restart", "echo"}),
        (conformance_plants.TakesAFailureSignalForAValue, {"failure-signal"}),
    ],
)
def test_one_mistake_breaks_no_rule_that_it_does_not_touch(faulty: type[Plant], alone: set[str]) -> None:
    assert broken(plant_results(faulty())) <= alone | {"rejoins"}


def test_the_report_names_the_first_frame_that_breaks_a_rule_and_the_fix() -> None:
    results = host_results(conformance_hosts.CountsByTwo())
    verdict, _, table, _, first, fix = blocks("host", results, START_NS)
    assert verdict == "the host breaks the rules: 12 pass, 1 fail, 0 not seen"
    assert isinstance(table, Table)
    assert [row[:2] for row in table.rows if row[0] != "pass"] == [("FAIL", "counter")]
    assert re.fullmatch(
        r"- counter, first: 0\.010000 s  1A0  ([0-9A-F]{2} ){8} SETPOINT has the counter 2 after 0 \(999 times\)",
        str(first),
    )
    assert fix == "- counter, fix: give each message a counter of its own, add 1 for each frame, and lose none"


def test_the_json_report_has_the_same_content() -> None:
    results = host_results(conformance_hosts.SpeaksInMetres())
    report = json.loads(json.dumps(as_values("host", results, START_NS)))
    assert (report["node"], report["conforms"]) == ("host", False)
    by_name = {rule["name"]: rule for rule in report["rules"]}
    assert {name for name, rule in by_name.items() if rule["verdict"] == "fail"} == {"travel"}
    assert by_name["travel"]["found"] == "Setpoint_mm = 200"
    assert by_name["travel"]["frame"]["time_s"] == 0.0
    assert by_name["travel"]["frame"]["id"] == "1A0"
    assert by_name["crc"]["frame"] is None


def reflected(covered: bytes) -> int:
    value = 0xFFFF
    for byte in covered:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ 0x8408 if value & 1 else value >> 1
    return value


def test_the_usual_mistakes_of_a_crc_are_named() -> None:
    data_id = 0x1F90
    good = CODEC.encode(StemPosition(0.08, 3), 9).data
    assert CODEC.by_kind[StemPosition].data_id == data_id
    body = good[2:]

    def text(crc: int) -> str:
        return mistake(crc.to_bytes(2, "little") + body, data_id, OFFSET)

    assert text(int.from_bytes(good[:2], "big")) == "its two bytes are swapped: the low byte comes first"
    assert text(e2e.crc(body, data_id - OFFSET)) == "id_offset is missing from the data ID"
    assert (
        text(e2e.crc(body, int.from_bytes(data_id.to_bytes(2, "big"), "little")))
        == "it covers the data ID high byte first"
    )
    assert text(e2e.crc(body[:-2], int.from_bytes(body[-2:], "little"))) == "it does not cover the data ID"
    assert text(e2e.crc(body, data_id) ^ 0xFFFF) == "it is inverted at the end"
    assert reflected(b"123456789") == 0x6F91  # the check value of CRC-16/MCRF4XX
    assert text(reflected(body + data_id.to_bytes(2, "little"))) == "it is reflected (CRC-16/MCRF4XX)"
    assert text(0) == "there is none: both its bytes are 0"
    assert text(0x1234) == ""
