"""How a picture is saved: PNG and SVG beside each other, the same ones in every run."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread

from positioner.pictures.files import save

if TYPE_CHECKING:
    from pathlib import Path


def figure() -> Figure:
    drawn = Figure(figsize=(4.0, 3.0), dpi=100)
    panel = drawn.subplots()
    panel.plot([0.0, 1.0, 2.0], [1.0, 3.0, 2.0], marker="o", label="a line")
    panel.set_title("Γ of the valve")
    panel.legend()
    return drawn


@pytest.mark.parametrize("name", ["drawn.png", "drawn.svg", "drawn"])
def test_a_picture_is_written_as_png_and_as_svg(tmp_path: Path, name: str) -> None:
    save(figure(), tmp_path / name)
    assert {path.name for path in tmp_path.iterdir()} == {"drawn.png", "drawn.svg"}
    assert imread(tmp_path / "drawn.png").shape == (300, 400, 4)
    assert "<svg" in (tmp_path / "drawn.svg").read_text("utf-8")


def test_two_runs_write_the_same_bytes(tmp_path: Path) -> None:
    save(figure(), tmp_path / "a.png")
    save(figure(), tmp_path / "b.png")
    for suffix in (".png", ".svg"):
        assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()


def test_text_in_the_svg_is_text_and_can_be_searched(tmp_path: Path) -> None:
    save(figure(), tmp_path / "a.svg")
    text = (tmp_path / "a.svg").read_text("utf-8")
    assert ">Γ of the valve<" in text
    assert "<dc:date>" not in text


def test_another_format_is_written_alone(tmp_path: Path) -> None:
    save(figure(), tmp_path / "a.pdf")
    assert [path.name for path in tmp_path.iterdir()] == ["a.pdf"]
