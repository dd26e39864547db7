"""Rounding to the steps of a signal: no end of a travel is refused for it, and no limit of the current overshot."""

from __future__ import annotations

import struct
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st
from test_cycle import VALVE, Exchange

from positioner.config.reader import load_config
from positioner.errors import ConfigurationError
from positioner.guard.settings import FailsafeAction, GuardSettings
from positioner.wire.codec import Codec, make_codec
from positioner.wire.fields import FieldFormat, field_format
from positioner.wire.loop_current import signal_of
from positioner.wire.messages import CurrentCommand, HostRequest, Mode, Setpoint
from positioner.wire.rounding import fits, inside, meant
from positioner.wire.settings import MessageSettings, WireSettings

if TYPE_CHECKING:
    from pathlib import Path

POSITION_SCALES = (
    ("mm", "0.00001"), ("mm", "0.0001"), ("mm", "0.001"), ("mm", "0.002"), ("mm", "0.01"), ("mm", "0.025"),
    ("mm", "0.03"), ("mm", "0.05"), ("mm", "0.1"), ("mm", "0.3"), ("mm", "0.7"), ("mm", "-0.01"), ("um", "1"),
    ("um", "7.62939453125"), ("cm", "0.01"), ("m", "0.0001"), ("%", "0.01"), ("%", "0.4"), ("%", "0.392157"),
    ("%", "1"),
)  # fmt: skip
CURRENT_SCALES = (
    ("mA", "0.001"), ("mA", "0.002"), ("mA", "0.005"), ("mA", "0.01"), ("mA", "0.016"), ("mA", "0.02"), ("mA", "0.05"),
    ("mA", "0.1"), ("mA", "0.15"), ("mA", "0.2"), ("mA", "0.25"), ("mA", "0.3"), ("mA", "0.5"), ("mA", "0.0784314"),
    ("uA", "1"), ("uA", "30"), ("A", "0.0001"), ("%", "0.01"), ("%", "0.392157"), ("%", "1"),
)  # fmt: skip
DBC = """VERSION ""
NS_ :
BS_:
BU_: PLC VALVE

BO_ 1281 Target: 8 PLC
 SG_ Target : 0|32@1- ({scale},0) [0|0] "{unit}" VALVE
 SG_ Request : 32|4@1+ (1,0) [0|0] "" VALVE

BO_ 1280 Drive: 8 PLC
 SG_ Demand : 0|32@1- ({scale},0) [0|0] "{unit}" VALVE
"""


def codec_of(folder: Path, unit: str, scale: str, *, position: bool) -> Codec:
    path = folder / "user.dbc"
    path.write_text(DBC.format(unit=unit, scale=scale), encoding="cp1252")
    target = MessageSettings(message="Target", signals={"setpoint_m": "Target", "request": "Request"})
    drive = MessageSettings(message="Drive", signals={"current_ma": "Demand"})
    wire = WireSettings(dbc=path, setpoint=target) if position else WireSettings(dbc=path, current_command=drive)
    return make_codec(wire, span_m=0.1)


def carried(form: FieldFormat, value: float) -> float:
    """Return `value` after it was rounded to the steps of the signal."""
    return round((value - form.si_offset) / form.si_per_bit) * form.si_per_bit + form.si_offset


@pytest.mark.parametrize(("unit", "scale"), POSITION_SCALES)
def test_both_ends_of_every_travel_are_accepted_and_none_is_exceeded(unit: str, scale: str, tmp_path: Path) -> None:
    codec = codec_of(tmp_path, unit, scale, position=True)
    signal = codec.by_kind[Setpoint].dbc.get_signal_by_name("Target")
    refused = []
    for tenths in range(50, 3001):
        low_m, high_m = -tenths / 30_000.0, tenths / 10_000.0
        form = field_format(Setpoint, "setpoint_m", signal, high_m)
        for end_m in (0.0, low_m, high_m):
            lowest_m = min(end_m, 0.0)
            understood_m = meant(form, carried(form, end_m), lowest_m, high_m)
            if understood_m is None:
                refused.append((lowest_m, high_m))
            else:
                assert lowest_m <= understood_m <= high_m
                assert understood_m == pytest.approx(end_m, abs=0.5000011 * abs(form.si_per_bit))
    assert refused == []


@pytest.mark.parametrize(("unit", "scale"), POSITION_SCALES)
def test_a_setpoint_that_more_than_rounding_puts_outside_is_refused(unit: str, scale: str, tmp_path: Path) -> None:
    form = codec_of(tmp_path, unit, scale, position=True).field(Setpoint, "setpoint_m")
    step_m = abs(form.si_per_bit)
    for high_m in (0.005, 0.0123, 0.1, 0.3):
        assert meant(form, high_m + 0.501 * step_m, 0.0, high_m) is None
        assert meant(form, -0.501 * step_m, 0.0, high_m) is None
        assert meant(form, high_m + 0.499 * step_m, 0.0, high_m) == high_m
        assert meant(form, -0.499 * step_m, 0.0, high_m) == 0.0


@pytest.mark.parametrize("tenths", [150, 180, 260, 300, 360, 600, 1397, 2999])
def test_the_full_travel_is_a_setpoint_with_which_one_can_arm(tenths: int) -> None:
    travel_m = tenths / 10_000.0
    exchange = Exchange(guard=GuardSettings())
    exchange.setup = replace(exchange.setup, valve=replace(VALVE, travel_max_m=travel_m, span_m=travel_m))
    exchange.sample(0.01, setpoint=Setpoint(travel_m))
    exchange.sample(0.01, setpoint=Setpoint(travel_m, HostRequest.ARM))
    assert exchange.state.guard.mode is Mode.ACTIVE
    assert exchange.state.link.setpoint.position_m == travel_m


@pytest.mark.parametrize(("unit", "scale"), CURRENT_SCALES)
def test_no_limit_of_the_current_is_overshot_by_rounding(unit: str, scale: str, tmp_path: Path) -> None:
    form = codec_of(tmp_path, unit, scale, position=False).field(CurrentCommand, "current_ma")
    noise_ma = 1e-5 * abs(form.si_per_bit)
    for low_tenths in range(38, 205):
        for high_tenths in (*range(low_tenths + 1, min(low_tenths + 12, 206)), 205):
            low_ma, high_ma = low_tenths / 10.0, high_tenths / 10.0
            if not fits(form, low_ma, high_ma):
                assert high_ma - low_ma < abs(form.si_per_bit)
                continue
            for wanted_ma in (low_ma, 0.5 * (low_ma + high_ma), high_ma):
                sent_ma = carried(form, inside(form, wanted_ma, low_ma, high_ma))
                assert low_ma - noise_ma <= sent_ma <= high_ma + noise_ma
                assert abs(sent_ma - wanted_ma) <= abs(form.si_per_bit) * 1.00001


@given(st.floats(3.8, 20.5))
def test_a_current_whose_rounding_stays_inside_is_left_as_it_is(current_ma: float) -> None:
    assert inside(make_codec().field(CurrentCommand, "current_ma"), current_ma, 3.8, 20.5) == current_ma


@given(st.sampled_from([(16, "e"), (32, "f"), (64, "d")]), st.floats(3.8, 20.0), st.floats(0.1, 1.0))
def test_floating_point_signals_keep_their_limits_too(layout: tuple[int, str], low_ma: float, width_ma: float) -> None:
    bits, letter = layout
    form = FieldFormat("current_ma", "Demand", 0.16, 4.0, -1e4, 1e4, None, bits)
    high_ma = low_ma + width_ma
    assert fits(form, low_ma, high_ma)
    for wanted_ma in (low_ma, high_ma):
        raw = (inside(form, wanted_ma, low_ma, high_ma) - 4.0) / 0.16
        sent_ma = struct.unpack(letter, struct.pack(letter, raw))[0] * 0.16 + 4.0
        assert low_ma <= sent_ma <= high_ma
        assert sent_ma == pytest.approx(wanted_ma, rel=3e-3)
        assert meant(form, sent_ma, low_ma, high_ma) == sent_ma


def test_a_value_that_no_step_can_come_near_is_left_to_the_check_at_the_start() -> None:
    coarse = FieldFormat("current_ma", "Demand", 5.0, 0.0, 0.0, 25.0, None)
    assert not fits(coarse, 11.0, 14.0)
    assert inside(coarse, 12.0, 11.0, 14.0) == 12.0
    assert not fits(coarse, 26.0, 30.0)


@pytest.mark.parametrize(
    ("guard", "sent_ma"),
    [
        (GuardSettings(auto_arm=True, current_high_ma=9.9), 9.6),
        (GuardSettings(auto_arm=True, current_low_ma=10.2), 10.4),
        (GuardSettings(auto_arm=True), 10.0),
    ],
)
def test_a_coarse_command_signal_keeps_the_guards_limits(guard: GuardSettings, sent_ma: float, tmp_path: Path) -> None:
    exchange = Exchange(guard=guard)
    exchange.setup = replace(exchange.setup, codec=codec_of(tmp_path, "mA", "0.4", position=False))
    message, _ = exchange.setup.codec.decode(exchange.sample()[0])
    assert isinstance(message, CurrentCommand)
    assert message.current_ma == pytest.approx(sent_ma)


@pytest.mark.parametrize(("failsafe_ma", "sent_ma"), [(21.0, 21.2), (3.5, 3.6), (3.3, 3.2), (4.3, 4.4), (3.8, 4.0)])
def test_a_failsafe_current_means_the_same_after_rounding(failsafe_ma: float, sent_ma: float, tmp_path: Path) -> None:
    guard = GuardSettings(
        auto_arm=True, failsafe_action=FailsafeAction.CURRENT, failsafe_current_ma=failsafe_ma, current_low_ma=5.0
    )
    exchange = Exchange(guard=guard)
    exchange.setup = replace(exchange.setup, codec=codec_of(tmp_path, "mA", "0.4", position=False))
    exchange.sample()
    message, _ = exchange.setup.codec.decode(exchange.step(elapsed_ns=100_000_000)[0])
    assert isinstance(message, CurrentCommand)
    assert message.current_ma == pytest.approx(sent_ma)
    assert signal_of(message.current_ma) is signal_of(failsafe_ma)


def test_limits_between_two_steps_of_the_command_signal_are_refused_at_the_check(tmp_path: Path) -> None:
    (tmp_path / "user.dbc").write_text(DBC.format(unit="mA", scale="5"), encoding="cp1252")
    path = tmp_path / "valve.toml"
    path.write_text(
        """valve = { id = "x", preset = "paper" }
[wire]
dbc = "user.dbc"
current_command = { message = "Drive", signals = { current_ma = "Demand" } }
[guard]
current_low_ma = 11.0
current_high_ma = 14.0
failsafe_action = "20 mA"
""",
        encoding="utf-8",
    )
    with pytest.raises(ConfigurationError) as caught:
        load_config(path)
    (problem,) = caught.value.problems
    message = "the command signal of the DBC has steps of 5 mA, and none from 11 to 14 mA"
    assert str(problem) == f"line 7: guard.current_high_ma = 14.0: {message}"
