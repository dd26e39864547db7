"""`check` and `doctor` say what error to expect, and where a law and a period do not fit a valve."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import pytest

from positioner.cli.check import summary_rows, warnings
from positioner.cli.main import main
from positioner.config.reader import parse_config
from positioner.doctor import cycle_time
from positioner.doctor.examination import Examination
from positioner.doctor.finding import Level
from positioner.reach.expected import in_words

if TYPE_CHECKING:
    from pathlib import Path


def text_of(law: str, period_s: float, valve: str = "paper") -> str:
    return (
        f'[valve]\nid = "v"\npreset = "{valve}"\n[control]\nlaw = "{law}"\nsample_period_s = {period_s}\n'
        "[estimator]\nnoise_of_reading = 0.0\nnoise_of_span = 0.0005\n"
    )


PAPER_TOO_LONG = "are too long for the law paper: in one period a push moves the stem so far; take nmpc, or less"
NO_LAG = "the law paper knows no lag, and this valve has one; take nmpc"
SLIP = "50 ms are too long for this valve, whose slip is nearly over after"


@pytest.fixture(autouse=True)
def few_cycles(monkeypatch: pytest.MonkeyPatch) -> None:
    """The doctor times a few cycles only."""
    monkeypatch.setattr(cycle_time, "CYCLES", 10)


@pytest.mark.parametrize(
    ("law", "period_s", "valve", "percent", "why"),
    [
        # closed loops of eight setpoints gave 0.03, 0.034, 0.033, 0.03 and 5.1 % for nmpc
        ("nmpc", 0.001, "paper", 0.031, ""),
        ("nmpc", 0.02, "paper", 0.034, ""),
        ("nmpc", 0.001, "real-valve", 0.038, ""),
        ("nmpc", 0.02, "real-valve", 0.04, ""),
        ("nmpc", 0.05, "paper", 4.3, SLIP),
        # and 2.0, 4.5 and 0.8 % for the paper's law at 3 and 5 ms, and with 50 ms of lag
        ("paper", 0.01, "paper", 2.3, PAPER_TOO_LONG),
        ("paper", 0.001, "real-valve", 0.64, NO_LAG),
        ("paper", 0.001, "paper", None, ""),
        ("pi", 0.02, "paper", None, ""),
    ],
)
def test_check_and_doctor_name_the_error_to_expect_and_a_law_or_period_that_does_not_fit(
    law: str, period_s: float, valve: str, percent: float | None, why: str, tmp_path: Path
) -> None:
    path = tmp_path / "valve.toml"
    path.write_text(text_of(law, period_s, valve), encoding="utf-8")
    configuration = parse_config(path.read_text(encoding="utf-8"), "valve.toml", tmp_path)
    error, told = in_words(configuration)
    assert (why in told) if why else (told == "")
    if percent is None:
        assert error == ""
    else:
        found = re.search(r"([\d.]+) % of span", error)
        assert found is not None
        assert float(found.group(1)) == pytest.approx(percent, rel=0.4)
    text = f"{error}: {told}" if told else error
    assert dict(summary_rows(configuration, tmp_path)).get("error to expect", "") == error
    assert (f"error to expect: {text}" in warnings(configuration)) == bool(told)
    findings = [finding for finding in Examination(path, tmp_path).findings() if finding.subject == "error"]
    assert [finding.text for finding in findings] == ([text] if text else [])
    for finding in findings:
        assert finding.level is (Level.WARN if why else Level.OK)
        assert finding.fix == ("" if not why else f"positioner reach --config {path}  # what would help")


def test_a_period_that_is_no_problem_is_no_warning(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "valve.toml"
    path.write_text(text_of("nmpc", 0.005), encoding="utf-8")
    assert main(["check", str(path)]) == 0
    out = capsys.readouterr().out
    assert "\nerror to expect  " in out
    assert "too long" not in out
