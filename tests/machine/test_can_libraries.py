"""What loads python-can or cantools does not load asammdf and pandas with it, whichever of our modules comes first."""

from __future__ import annotations

import subprocess
import sys

import pytest


@pytest.mark.parametrize("module", ["positioner.wire.codec", "positioner.wire.foreign", "positioner.bus.port"])
def test_the_libraries_of_the_bus_come_without_asammdf(module: str) -> None:
    code = f"import sys, {module}; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True, timeout=300.0)
    loaded = set(done.stdout.split())
    assert "can" in loaded
    assert not {"asammdf", "pandas"} & loaded
