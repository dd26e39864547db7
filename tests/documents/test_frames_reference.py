"""The reference of the frames has every message and signal of the DBC, with unit and values."""

from __future__ import annotations

import re
from pathlib import Path

from documents.frames import page

DBC = (Path(__file__).resolve().parents[2] / "dbc" / "positioner.dbc").read_text(encoding="utf-8")


def test_every_message_and_every_signal_of_the_dbc_is_on_the_page() -> None:
    text = page()
    messages = re.findall(r"^BO_ (\d+) (\w+):", DBC, re.MULTILINE)
    assert re.findall(r"^## (\w+)$", text, re.MULTILINE) == [
        name for _, name in sorted(messages, key=lambda each: int(each[0]))
    ]
    signals = re.findall(r"^ SG_ (\w+) ", DBC, re.MULTILINE)
    assert len(re.findall(r"^\| `\w+` \|", text, re.MULTILINE)) == len(signals)
    assert all(f"| `{name}` |" in text for name in signals)


def test_a_row_has_bits_range_step_and_unit_and_another_its_names() -> None:
    text = page()
    assert "| `Position_mm` | 24 to 51, signed | -1342 to 1342 | 1e-05 | mm |  |" in text
    assert "| `Request` | 52 to 55 |  | 1 |  | 0 NONE, 1 ARM, 2 DISARM |" in text
