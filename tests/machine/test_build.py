"""Doctor and `--version` tell which build runs."""

from __future__ import annotations

from importlib.machinery import EXTENSION_SUFFIXES, ModuleSpec

import pytest

from positioner.doctor import machine
from positioner.machine.build import version


@pytest.mark.parametrize(
    ("file", "name", "fixed"),
    [("step.py", "interpreted", True), (f"step{EXTENSION_SUFFIXES[0]}", "compiled", False)],
)
def test_the_build_that_runs_is_told(file: str, name: str, fixed: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    spec = ModuleSpec("positioner.cycle.step", None, origin=f"/lib/positioner/cycle/{file}")
    monkeypatch.setattr("positioner.machine.build.find_spec", lambda _: spec)
    assert version("positioner", "1.2.3") == f"positioner 1.2.3 ({name})"
    finding = machine.build()
    assert (finding.text.split(",")[0], "gcc" in finding.fix) == (name, fixed)
