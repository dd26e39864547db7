"""A current that cannot be sent is found before the valve needs it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from positioner.config.reader import parse_config
from positioner.errors import ConfigurationError
from positioner.wire.messages import CurrentCommand

if TYPE_CHECKING:
    from pathlib import Path

# 10 to 90 % of 4 to 20 mA: 5.6 to 18.4 mA
DBC = """VERSION ""
BU_: PLANT POSITIONER
BO_ 513 IP_COMMAND: 2 POSITIONER
 SG_ LoopCurrent : 0|16@1+ (0.01,0) [10|90] "%" PLANT
"""
VALVE = """[valve]
id = "v"
preset = "paper"
[wire]
dbc = "narrow.dbc"
[wire.current_command]
message = "IP_COMMAND"
signals = { current_ma = "LoopCurrent" }
[guard]
"""
INSIDE = "current_low_ma = 5.6\ncurrent_high_ma = 18.4\n"


@pytest.mark.parametrize(
    ("guard", "expected"),
    [
        ("", ["guard.current_low_ma = 4.0", "guard.current_high_ma = 20.0", "guard.failsafe_action = 4 mA"]),
        (INSIDE, ["guard.failsafe_action = 4 mA"]),
        (f'{INSIDE}failsafe_action = "20 mA"\nfailsafe_current_ma = 6.0\n', ["guard.failsafe_action = 20 mA"]),
        (f'{INSIDE}failsafe_action = "current"\n', ["guard.failsafe_current_ma = 4.0"]),
        (f'{INSIDE}failsafe_action = "current"\nfailsafe_current_ma = 3.6\n', ["guard.failsafe_current_ma = 3.6"]),
        (f'{INSIDE}failsafe_action = "current"\nfailsafe_current_ma = 6.0\n', []),
        (f'{INSIDE}failsafe_action = "hold"\n', []),
    ],
)
def test_every_current_that_the_guard_may_command_fits_the_frame_or_is_reported_at_the_start(
    guard: str, expected: list[str], tmp_path: Path
) -> None:
    (tmp_path / "narrow.dbc").write_text(DBC, encoding="utf-8")
    if expected:
        with pytest.raises(ConfigurationError) as caught:
            parse_config(VALVE + guard, "valve.toml", tmp_path)
        assert sorted(problem.where for problem in caught.value.problems) == sorted(expected)
        assert all("does not fit the command frame" in problem.message for problem in caught.value.problems)
        return
    configuration = parse_config(VALVE + guard, "valve.toml", tmp_path)
    codec, settings = configuration.make_codec(), configuration.guard
    for last_ma in (settings.current_low_ma, settings.current_high_ma):
        codec.encode(CurrentCommand(settings.failsafe_ma(last_ma)), 0)
