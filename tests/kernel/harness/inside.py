"""A pytest plugin for inside a kernel: every report goes into a file that the host reads, a line each."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING

from harness.plan import RESULTS

if TYPE_CHECKING:
    import pytest

_CONFIG: list[pytest.Config] = []


def pytest_configure(config: pytest.Config) -> None:
    """Keep the configuration, whose hooks turn reports into data."""
    _CONFIG.append(config)


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Hand a report over at once: a kernel that ends later cannot lose it."""
    data = _CONFIG[0].hook.pytest_report_to_serializable(config=_CONFIG[0], report=report)
    with Path(os.environ[RESULTS]).open("a", encoding="utf-8") as lines:
        lines.write(json.dumps(data, default=str) + "\n")
