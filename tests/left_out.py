"""The summary of a run names the tests that it leaves out because they are marked `slow`, each with its short form."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from collections.abc import Sequence

_KEY = "left_out"
_FOLDER = "tests/"


class LeftOut:
    """Collects the tests, also in the workers of pytest-xdist, and prints one line for each."""

    def __init__(self, config: pytest.Config) -> None:
        """Begin with none."""
        self._config = config
        self.tests: Counter[str] = Counter()

    def pytest_deselected(self, items: Sequence[pytest.Item]) -> None:
        """Take note of the tests that `-m 'not slow'` has left out."""
        if "not slow" not in self._config.option.markexpr:
            return
        for item in items:
            mark = item.get_closest_marker("slow")
            if mark is not None:
                name = item.nodeid.split("[")[0].removeprefix(_FOLDER)
                self.tests[f"{name}: {mark.kwargs['short']}"] += 1

    def pytest_sessionfinish(self) -> None:
        """Tell the controller, from a worker."""
        output = getattr(self._config, "workeroutput", None)
        if output is not None:
            output[_KEY] = dict(self.tests)

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node: Any) -> None:
        """Take over what a worker has told; each of them has collected all tests."""
        self.tests |= Counter(getattr(node, "workeroutput", {}).get(_KEY, {}))

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        """Print the tests."""
        if not self.tests:
            return
        terminalreporter.section(f"left out: {self.tests.total()} slow tests, and what stands for each in this run")
        for line, count in sorted(self.tests.items()):
            terminalreporter.line(line if count == 1 else f"{line} ({count} cases)")
