"""The doctor on CAN interfaces: answers of `ip` read, and what they mean for a control loop."""

from __future__ import annotations

import pytest
from link_answers import ALL, LOOPBACK, MCP251X, PEAK_USB, VCAN0, VXCAN_DOWN, changed, down

from positioner.doctor.finding import Finding, Level, worst
from positioner.doctor.link import Link, UnreadableAnswerError, parse_links
from positioner.doctor.link_findings import findings


def one(answer: str) -> Link:
    (link,) = parse_links(answer)
    return link


def found(answer: str, name: str = "can0") -> dict[str, Finding]:
    """Return the findings by subject; of two on one subject the worse."""
    by_subject: dict[str, Finding] = {}
    for finding in findings(name, parse_links(answer)):
        if finding.subject not in by_subject or finding.level > by_subject[finding.subject].level:
            by_subject[finding.subject] = finding
    return by_subject


def test_a_controller_is_read_with_its_bitrate_queue_restart_and_state() -> None:
    link = one(MCP251X)
    assert (link.name, link.is_can, link.is_controller, link.is_up) == ("can0", True, True, True)
    assert (link.bitrate, link.sample_point, link.queue_frames, link.restart_ms) == (500_000, 0.875, 10, 0)
    assert (link.state, link.error_counters) == ("ERROR-ACTIVE", None)


def test_error_counters_control_modes_and_a_sample_point_that_is_a_number_are_read() -> None:
    link = one(PEAK_USB)
    assert (link.bitrate, link.sample_point, link.queue_frames, link.restart_ms) == (1_000_000, 0.75, 128, 100)
    assert (link.error_counters, link.control_modes) == ((0, 1), frozenset({"BERR-REPORTING"}))


def test_a_virtual_bus_has_no_controller_and_a_network_card_is_no_can_bus() -> None:
    assert not one(VCAN0).is_controller
    assert (one(VCAN0).is_can, one(VCAN0).kind, one(VCAN0).bitrate, one(VCAN0).restart_ms) == (True, "vcan", None, None)
    assert (one(VXCAN_DOWN).is_can, one(VXCAN_DOWN).is_up) == (True, False)
    assert not one(LOOPBACK).is_can


def test_all_interfaces_come_in_their_order_and_holes_are_skipped() -> None:
    assert [link.name for link in parse_links(ALL)] == ["lo", "vcan0", "vx1", "can0", "can1"]
    assert [link.name for link in parse_links("[{}," + MCP251X[1:])] == ["can0"]
    assert parse_links("") == ()


def test_a_fixed_bitrate_is_read_where_the_controller_has_no_timing() -> None:
    data = '"bittiming_bitrate":250000,"bitrate_const":[250000,500000],"restart_ms":100,"state":"ERROR-ACTIVE"'
    answer = (
        '[{"ifname":"can0","flags":["UP"],"txqlen":128,"link_type":"can","linkinfo":{"info_kind":"can","info_data":'
    )
    assert one(answer + "{" + data + "}}}]").bitrate == 250_000


@pytest.mark.parametrize(
    "answer", ["state ERROR-ACTIVE", "[1]", '[{"flags": []}]', '{"a": 1}', '[{"ifname":"a","txqlen":"x"}]']
)
def test_an_answer_that_is_something_else_is_refused(answer: str) -> None:
    with pytest.raises(UnreadableAnswerError):
        parse_links(answer)


def test_a_well_set_up_controller_needs_no_fix() -> None:
    listed = findings("can1", parse_links(PEAK_USB))
    assert worst(listed) is Level.OK
    assert [finding.fix for finding in listed] == [""] * 5
    assert listed[0].text == "can1 is up at 1000 kbit/s, sample point 75.0 %"
    assert listed[3].text == "can1 is ERROR-ACTIVE, error counters: transmit 0, receive 1"


def test_a_short_queue_and_no_restart_are_warnings_with_their_fixes() -> None:
    by_subject = found(MCP251X)
    assert {subject for subject, finding in by_subject.items() if finding.level is Level.WARN} == {"queue", "restart"}
    assert by_subject["queue"].fix == "sudo ip link set can0 txqueuelen 128"
    assert by_subject["restart"].fix == (
        "sudo ip link set can0 down && sudo ip link set can0 up type can bitrate 500000 restart-ms 100"
        "  # where the driver can (slcan cannot)"
    )


@pytest.mark.parametrize(("length", "level"), [(127, Level.WARN), (128, Level.OK)])
def test_the_queue_is_long_enough_at_128_frames(length: int, level: Level) -> None:
    assert found(MCP251X.replace('"txqlen":10', f'"txqlen":{length}'))["queue"].level is level


def test_an_interface_that_is_down_is_brought_up_at_its_own_bitrate() -> None:
    by_subject = found(down(MCP251X))
    assert (by_subject["interface"].level, by_subject["interface"].text) == (Level.FAIL, "can0 is down")
    assert by_subject["interface"].fix == "sudo ip link set can0 up type can bitrate 500000 restart-ms 100"
    assert "controller" not in by_subject  # a stopped controller is the same fact again


def test_a_virtual_bus_that_is_down_is_only_brought_up() -> None:
    assert found(VXCAN_DOWN, "vx1")["interface"].fix == "sudo ip link set vx1 up"
    assert worst(findings("vcan0", parse_links(VCAN0))) is Level.OK


def test_a_controller_never_configured_gets_a_bitrate() -> None:
    unset = down(MCP251X).replace('"bitrate": 500000', '"bitrate": 0')
    assert found(unset)["interface"].fix == "sudo ip link set can0 up type can bitrate 1000000 restart-ms 100"


@pytest.mark.parametrize(
    ("state", "level"),
    [("ERROR-ACTIVE", Level.OK), ("ERROR-WARNING", Level.WARN), ("ERROR-PASSIVE", Level.WARN), ("BUS-OFF", Level.FAIL),
     ("STOPPED", Level.FAIL), ("SLEEPING", Level.FAIL)],
)  # fmt: skip
def test_the_state_of_the_controller_sets_the_level(state: str, level: Level) -> None:
    finding = found(changed(PEAK_USB, state=state, berr_counter={"tx": 136, "rx": 7}), "can1")["controller"]
    assert (finding.level, bool(finding.fix)) == (level, level is not Level.OK)
    assert finding.text.startswith(f"can1 is {state}, error counters: transmit 136, receive 7")
    if level is Level.FAIL:
        assert finding.fix == "sudo ip link set can1 down && sudo ip link set can1 up"


@pytest.mark.parametrize("mode", ["LISTEN-ONLY", "ONE-SHOT", "LOOPBACK"])
def test_a_mode_that_no_control_loop_can_use_fails(mode: str) -> None:
    finding = found(changed(PEAK_USB, ctrlmode=[mode]), "can1")["controller"]
    assert finding.level is Level.FAIL
    assert finding.fix == f"sudo ip link set can1 down && sudo ip link set can1 up type can {mode.lower()} off"


def test_errors_of_the_past_are_counted() -> None:
    finding = found(changed(PEAK_USB, over_errors=3, totals={"bus_off": 2, "restarts": 1}), "can1")["bus history"]
    assert finding.level is Level.WARN
    assert finding.text == "bus-off 2, restarts 1, receive overruns 3 on can1 since its driver was loaded"


def test_an_interface_that_is_missing_is_made_where_it_is_virtual_and_looked_for_where_not() -> None:
    made = found(LOOPBACK, "vcan0")["interface"]
    assert (made.level, made.text) == (Level.FAIL, "vcan0 does not exist; this machine has no CAN bus")
    assert made.fix == "sudo modprobe vcan; sudo ip link add dev vcan0 type vcan && sudo ip link set vcan0 up"
    missing = found(ALL, "can7")["interface"]
    assert (missing.level, missing.text) == (
        Level.FAIL,
        "can7 does not exist; this machine has vcan0, vx1, can0, can1",
    )
    assert missing.fix.startswith("sudo dmesg")


def test_a_network_card_is_no_bus() -> None:
    finding = found(LOOPBACK, "lo")["interface"]
    assert (finding.level, "is no CAN interface" in finding.text) == (Level.FAIL, True)
