"""The notebooks as they are kept: without results, which `make notebooks` adds, and with code that can be read."""

from __future__ import annotations

import ast
import json
from pathlib import Path
from typing import Any

import pytest

import positioner

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOKS = sorted((ROOT / "examples").glob("*.ipynb"))


def code_of(path: Path) -> list[dict[str, Any]]:
    return [cell for cell in json.loads(path.read_text(encoding="utf-8"))["cells"] if cell["cell_type"] == "code"]


def test_there_are_two_notebooks() -> None:
    assert [path.stem for path in NOTEBOOKS] == ["own-law", "stiction"]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_kept_without_results(path: Path) -> None:
    cells = code_of(path)
    assert len(cells) > 4
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in cells)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_its_code_is_python_and_imports_only_what_the_package_offers(path: Path) -> None:
    source = "".join("".join(cell["source"]) + "\n" for cell in code_of(path))
    tree = ast.parse("\n".join(line for line in source.splitlines() if not line.startswith("!")))
    imported = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module == "positioner"]
    names = {alias.name for node in imported for alias in node.names}
    assert names == {"simulate"}
    assert names <= set(positioner.__all__)
