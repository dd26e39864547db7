"""A pytest plugin for the host: tests marked for a kernel run in one, and report here as if they had run here."""

from __future__ import annotations

import os
import subprocess
from collections import defaultdict
from functools import cache
from typing import TYPE_CHECKING, Any

import pytest

from harness import fleet, wheels
from harness.packages import CannotFetchError
from harness.plan import KINDS, kind_inside

if TYPE_CHECKING:
    from collections.abc import Sequence

_SLOWEST_FIRST = ("controller", "systemd", "faults", "vcan")


class Dispatcher:
    """Sends the collected tests into kernels, and their reports to pytest."""

    def __init__(self) -> None:
        """Begin with nothing told."""
        self.more_tries: list[str] = []

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool | None:
        """Run everything; a test that fails gets two more tries, in a kernel that has the machine for itself."""
        if session.config.option.collectonly:
            return None
        if session.testsfailed:
            raise session.Interrupted(f"{session.testsfailed} errors during collection")
        here = [item for item in session.items if _kind(item) == "vcan" and host_has_vcan()]
        for index, item in enumerate(here):
            following = here[index + 1] if index + 1 < len(here) else None
            item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
        away = [item for item in session.items if item not in here]
        failed = self._run(session, away, os.cpu_count() or 1, last=False)
        failed = self._run(session, failed, 1, last=False)
        self._run(session, failed, 1, last=True)
        return True

    def _run(
        self, session: pytest.Session, items: Sequence[pytest.Item], at_once: int, *, last: bool
    ) -> list[pytest.Item]:
        """Run `items` and return those that failed, unless this was the last try: then they are told as failed."""
        by_id = {item.nodeid: item for item in items}
        told: dict[str, list[pytest.TestReport]] = defaultdict(list)
        failed: list[pytest.Item] = []
        try:
            if any(KINDS[_kind(item)].booted for item in items):
                wheels.fetch()
            for guest, data in fleet.run(_groups(items), at_once):
                if data is None:
                    for nodeid in guest.tests:
                        if not any(report.when == "teardown" for report in told[nodeid]):
                            told[nodeid].append(_died(by_id[nodeid], guest))
                            self._tell(by_id[nodeid], told[nodeid], failed, last=last)
                    continue
                report = _unskipped(
                    session.config.hook.pytest_report_from_serializable(config=session.config, data=data)
                )
                told[report.nodeid].append(report)
                if report.when == "teardown":
                    self._tell(by_id[report.nodeid], told[report.nodeid], failed, last=last)
        except CannotFetchError as error:
            pytest.exit(str(error), returncode=3)
        return failed

    def _tell(
        self,
        item: pytest.Item,
        reports: Sequence[pytest.TestReport],
        failed: list[pytest.Item],
        *,
        last: bool,
    ) -> None:
        """Hand the reports of one test to pytest, or keep it for another try."""
        bad = next((report for report in reports if report.failed), None)
        if bad is not None and not last:
            failed.append(item)
            self.more_tries.append(f"{item.nodeid}\n{bad.longreprtext}")
            return
        item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
        for report in reports:
            item.ihook.pytest_runtest_logreport(report=report)
        item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        """Show what needed another try, and why: nothing is hidden."""
        if self.more_tries:
            terminalreporter.section("failed at first, and were run again alone")
            for text in self.more_tries:
                terminalreporter.line(text)


@cache
def host_has_vcan() -> bool:
    """Return whether this host itself can make a virtual CAN interface."""
    if kind_inside() is not None or os.getuid() != 0:
        return False
    name = "vcanprobe"
    made = subprocess.run(["ip", "link", "add", "dev", name, "type", "vcan"], check=False, capture_output=True)
    if made.returncode == 0:
        subprocess.run(["ip", "link", "delete", name], check=False, capture_output=True)
    return made.returncode == 0


def _kind(item: pytest.Item) -> str:
    mark = item.get_closest_marker("kernel")
    if mark is None or mark.args[0] not in KINDS:
        raise pytest.UsageError(f"{item.nodeid} is not marked @pytest.mark.kernel(one of {', '.join(KINDS)})")
    return str(mark.args[0])


def _groups(items: Sequence[pytest.Item]) -> list[tuple[str, str, list[str]]]:
    """Return (kind, name, tests) of each file and kind, the slowest kinds first."""
    groups: dict[tuple[str, str], list[str]] = defaultdict(list)
    for item in items:
        groups[_kind(item), item.path.stem].append(item.nodeid)
    order = sorted(groups, key=lambda key: (_SLOWEST_FIRST.index(key[0]), key[1]))
    return [(kind, f"{kind}-{stem}", groups[kind, stem]) for kind, stem in order]


def _died(item: pytest.Item, guest: fleet.Guest) -> pytest.TestReport:
    text = f"the kernel ended before this test did\n{guest.last_words()}"
    return pytest.TestReport(item.nodeid, item.location, {}, "failed", text, "call")


def _unskipped(report: pytest.TestReport) -> pytest.TestReport:
    """Return the report, as a failure where it was skipped: in a kernel made for a test nothing is missing."""
    if report.skipped:
        report.outcome = "failed"
        report.longrepr = f"skipped inside its kernel: {report.longrepr}"
    return report
