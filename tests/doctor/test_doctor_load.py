"""The doctor on the load of the bus, against the literature's longest frames."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cantools
import pytest

from positioner.doctor.bus_load import bus_load, findings, frame_bits, rounded_up
from positioner.doctor.finding import Level
from positioner.wire.codec import make_codec
from positioner.wire.settings import MessageSettings, WireSettings

if TYPE_CHECKING:
    from pathlib import Path

OURS = make_codec()
LONGEST = 135
"""Bits of an 8-byte frame with a standard identifier (Davis et al. 2007, table 1: 55 bits and 10 for each byte)."""
OTHERS = LONGEST * (100 + 100 + 10)
"""Bits in a second of setpoint, pressure and status frames."""

USERS_DBC = """VERSION ""
NS_ :
BS_:
BU_: VALVE HOST
BO_ 2566844927 VALVE_FEEDBACK: 4 VALVE
 SG_ StemPosition : 7|16@0+ (0.01,0) [0|110] "%" HOST
BO_ 2566844926 IP_COMMAND: 2 HOST
 SG_ LoopCurrent : 0|16@1+ (0.01,0) [0|100] "%" VALVE
"""


@pytest.mark.parametrize("data_bytes", range(9))
def test_the_longest_form_of_a_frame_is_that_of_the_literature(data_bytes: int) -> None:
    assert frame_bits(data_bytes, is_extended=False) == 55 + 10 * data_bytes
    assert frame_bits(data_bytes, is_extended=True) == 80 + 10 * data_bytes


@pytest.mark.parametrize(("period_s", "bitrate"), [(0.001, 1_000_000), (0.001, 500_000), (0.01, 125_000)])
def test_the_load_is_two_frames_a_sample_and_the_slow_ones(period_s: float, bitrate: int) -> None:
    load = bus_load(OURS, period_s, bitrate)
    assert load.of_samples == pytest.approx(2 * LONGEST / period_s / bitrate, rel=1e-12)
    assert load.of_others == pytest.approx(OTHERS / bitrate, rel=1e-12)
    assert load.total == pytest.approx(load.of_samples + load.of_others, rel=1e-12)


def test_position_and_command_at_1_khz_take_27_percent_of_1_mbit_per_s() -> None:
    assert bus_load(OURS, 0.001, 1_000_000).of_samples == pytest.approx(0.27, rel=1e-12)


def test_at_the_shortest_period_the_load_is_the_most_that_is_allowed() -> None:
    shortest_s = bus_load(OURS, 0.001, 250_000).shortest_period_s
    assert shortest_s is not None
    assert bus_load(OURS, shortest_s, 250_000).total == pytest.approx(0.9, rel=1e-12)


def test_short_extended_frames_of_a_users_dbc_are_counted_as_they_are(tmp_path: Path) -> None:
    path = tmp_path / "users.dbc"
    path.write_text(USERS_DBC, encoding="utf-8")
    assert cantools.database.load_file(path)
    wire = WireSettings(
        dbc=path,
        stem_position=MessageSettings(message="VALVE_FEEDBACK", signals={"position_m": "StemPosition"}),
        current_command=MessageSettings(message="IP_COMMAND", signals={"current_ma": "LoopCurrent"}),
    )
    load = bus_load(make_codec(wire), 0.001, 1_000_000)
    assert load.of_samples == pytest.approx((120 + 100) / 1000, rel=1e-12)


@pytest.mark.parametrize(
    ("bitrate", "period_s", "level"),
    [
        (1_000_000, 0.001, Level.OK),  # 30 %
        (500_000, 0.001, Level.OK),  # 59.67 %
        (490_000, 0.001, Level.WARN),  # 60.89 %
        (350_000, 0.001, Level.WARN),  # 85.24 %
        (330_000, 0.001, Level.FAIL),  # 90.41 %
        (250_000, 0.002, Level.WARN),  # 65.34 %
        (1_000_000, 0.0001, Level.FAIL),  # the paper's 10 kHz: 273 %
        (10_000, 0.1, Level.FAIL),  # the slow ones alone: 284 %
    ],
)
def test_a_load_above_60_percent_is_a_warning_and_above_90_a_failure(
    bitrate: int, period_s: float, level: Level
) -> None:
    (finding,) = findings(OURS, period_s, "can0", bitrate)
    assert (finding.level, bool(finding.fix)) == (level, level is not Level.OK)
    assert f"{100 * (2 * LONGEST / period_s + OTHERS) / bitrate:.0f} % of" in finding.text


def test_a_refusal_names_the_shortest_period_that_fits_and_where_to_set_it() -> None:
    (finding,) = findings(OURS, 0.001, "can0", 250_000, "/etc/positioner/fv101.toml")
    # 270 bits within what 90 % of 250 kbit/s leave beside 28350 bit/s: 1.372998 ms
    assert "the shortest period that fits is 0.001373 s: 728 samples/s" in finding.text
    assert finding.fix.startswith("sudoedit /etc/positioner/fv101.toml  # [control] sample_period_s")
    assert bus_load(OURS, 0.001373, 250_000).total <= 0.9 < bus_load(OURS, 0.001372, 250_000).total


def test_a_warning_below_1_mbit_per_s_names_the_faster_bus_and_at_it_the_period() -> None:
    (slow,) = findings(OURS, 0.001, "can0", 400_000)
    assert slow.fix.startswith("sudo ip link set can0 down && sudo ip link set can0 up type can bitrate 1000000 ")
    (fast,) = findings(OURS, 0.0004, "can0", 1_000_000, "valve.toml")
    assert fast.fix.startswith("sudoedit valve.toml")


def test_a_virtual_bus_has_no_load() -> None:
    (finding,) = findings(OURS, 0.001, "vcan0", None)
    assert finding.level is Level.OK
    assert finding.text == "vcan0 has no bitrate, so no limit; at 1 Mbit/s the load of this valve would be 30 %"


@pytest.mark.parametrize(("period_s", "up_s"), [(0.0013730401, 0.001374), (0.001373, 0.001373), (0.1 + 0.2, 0.3)])
def test_a_period_is_rounded_up_to_whole_microseconds(period_s: float, up_s: float) -> None:
    assert rounded_up(period_s) == up_s
