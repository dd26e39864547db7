"""The kernel of the tests itself."""
from __future__ import annotations
import os
import pytest
pytestmark = pytest.mark.kernel("vcan")

def test_a() -> None:
    assert os.getpid() > 1

def test_b() -> None:
    assert os.path.exists("/sys/class/net/vcan0"), os.listdir("/sys/class/net")

def test_c() -> None:
    pytest.skip("x")
