"""`check` and `doctor` say what error to expect, and where a law and a period do not fit a valve."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from positioner.cli.check import summary
from positioner.cli.main import main
from positioner.config.reader import parse_config
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


TOO_LONG = "are too long for this valve: in one period it slips"
PAPER_TOO_LONG = "are too long for the law paper: in one period a push moves the stem so far; take nmpc, or less"


@pytest.mark.parametrize(
    ("law", "period_s", "valve", "expected"),
    [
        ("nmpc", 0.001, "paper", "0.022 % of span on average"),
        ("nmpc", 0.001, "real-valve", "0.038 % of span on average"),
        (
            "nmpc",
            0.02,
            "paper",
            f"0.79 % of span on average: 20 ms {TOO_LONG} 4.6 of the 5.4 mm of its natural jump; 5 ms would do",
        ),
        (
            "paper",
            0.01,
            "paper",
            f"above 2.3 % of span: 10 ms {PAPER_TOO_LONG}",
        ),
        ("paper", 0.001, "paper", ""),
        (
            "paper",
            0.001,
            "real-valve",
            "about 0.64 % of span: the law paper knows no lag, and this valve has one; take nmpc",
        ),
        ("pi", 0.02, "paper", ""),
    ],
)
def test_check_and_doctor_name_the_error_to_expect_and_a_law_or_period_that_does_not_fit(
    law: str, period_s: float, valve: str, expected: str, tmp_path: Path
) -> None:
    path = tmp_path / "valve.toml"
    path.write_text(text_of(law, period_s, valve), encoding="utf-8")
    configuration = parse_config(path.read_text(encoding="utf-8"), "valve.toml", tmp_path)
    assert in_words(configuration)[0] == expected
    rows = dict(line.strip().split("  ", 1) for line in summary(configuration, tmp_path).splitlines())
    assert rows.get("error to expect", "").strip() == expected
    # more than one sentence: something does not fit
    findings = [finding for finding in Examination(path, tmp_path).findings() if finding.subject == "error"]
    assert [finding.text for finding in findings] == ([expected] if expected else [])
    assert [finding.level for finding in findings] == (
        [Level.WARN if ":" in expected else Level.OK] if expected else []
    )
    if ":" in expected:
        assert findings[0].fix == f"positioner reach --config {path}  # what would help"


def test_the_period_that_would_do_does(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "valve.toml"
    path.write_text(text_of("nmpc", 0.005), encoding="utf-8")
    assert main(["check", str(path)]) == 0
    out = capsys.readouterr().out
    assert "  error to expect  " in out
    assert "too long" not in out
