"""Loop currents by NAMUR NE 43, at their borders."""

from __future__ import annotations

import math

import pytest

from positioner.errors import ConfigurationError
from positioner.guard.settings import FailsafeAction, GuardSettings
from positioner.guard.state import GuardState
from positioner.guard.supervisor import admit
from positioner.inputs.toml_reader import build
from positioner.wire.codec import make_codec
from positioner.wire.loop_current import LoopSignal, same_signal, signal_of
from positioner.wire.messages import CurrentCommand, Mode

VALUE, FAILURE, NEITHER = LoopSignal.VALUE, LoopSignal.FAILURE, LoopSignal.NEITHER

BORDERS = [
    (0.0, FAILURE),
    (3.6, FAILURE),
    (math.nextafter(3.6, 4.0), NEITHER),
    (3.601, NEITHER),
    (3.799, NEITHER),
    (math.nextafter(3.8, 3.0), NEITHER),
    (3.8, VALUE),
    (4.0, VALUE),
    (20.0, VALUE),
    (20.5, VALUE),
    (math.nextafter(20.5, 21.0), NEITHER),
    (20.999, NEITHER),
    (math.nextafter(21.0, 20.0), NEITHER),
    (21.0, FAILURE),
    (22.0, FAILURE),
    (math.nan, FAILURE),
    (math.inf, FAILURE),
    (-math.inf, FAILURE),
]


@pytest.mark.parametrize(("current_ma", "expected"), BORDERS)
def test_ne_43_separates_values_from_failures(current_ma: float, expected: LoopSignal) -> None:
    assert signal_of(current_ma) is expected


@pytest.mark.parametrize(("current_ma", "expected"), [(3.6, FAILURE), (3.8, VALUE), (20.5, VALUE), (21.0, FAILURE)])
def test_the_borders_survive_the_wire(current_ma: float, expected: LoopSignal) -> None:
    codec = make_codec()
    decoded, _ = codec.decode(codec.encode(CurrentCommand(current_ma), 0))
    assert isinstance(decoded, CurrentCommand)
    assert signal_of(decoded.current_ma) is expected


@pytest.mark.parametrize("current_ma", [0.0, 3.6, 3.8, 20.5, 21.0, 22.0])
def test_a_failsafe_current_may_be_a_value_or_a_failure_signal(current_ma: float) -> None:
    settings = GuardSettings(failsafe_action=FailsafeAction.CURRENT, failsafe_current_ma=current_ma)
    assert admit(settings, GuardState(Mode.FAILSAFE), 12.0, 12.0, 0.001) == current_ma


@pytest.mark.parametrize("current_ma", [3.601, 3.799, 20.501, 20.999, -0.001, 22.001])
def test_a_failsafe_current_that_is_neither_is_refused(current_ma: float) -> None:
    with pytest.raises(ConfigurationError, match="failsafe_current_ma"):
        build({"failsafe_current_ma": current_ma}, GuardSettings, "guard")


@pytest.mark.parametrize("key", ["current_low_ma", "current_high_ma"])
@pytest.mark.parametrize("current_ma", [3.799, 20.501])
def test_control_itself_stays_within_the_values(key: str, current_ma: float) -> None:
    with pytest.raises(ConfigurationError, match=key):
        build({key: current_ma}, GuardSettings, "guard")


@pytest.mark.parametrize(
    ("current_ma", "low_ma", "high_ma"),
    [
        (0.0, 0.0, 3.6),
        (3.6, 0.0, 3.6),
        (3.8, 3.8, 20.5),
        (20.5, 3.8, 20.5),
        (21.0, 21.0, 22.0),
        (22.0, 21.0, 22.0),
    ],
)
def test_the_range_of_one_meaning_reaches_from_border_to_border(
    current_ma: float, low_ma: float, high_ma: float
) -> None:
    assert same_signal(current_ma) == (low_ma, high_ma)
    assert signal_of(low_ma) is signal_of(high_ma) is signal_of(current_ma)
