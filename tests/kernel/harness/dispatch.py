"""A pytest plugin for the host: tests marked for a kernel run in one, and report here as if they had run here."""

from __future__ import annotations

import os
import subprocess
from collections import defaultdict
from functools import cache
from typing import TYPE_CHECKING, Any

import pytest

from harness import fleet, wheels
from harness.ledger import Ledger
from harness.packages import CannotFetchError
from harness.plan import KINDS, kind_inside

if TYPE_CHECKING:
    from collections.abc import Sequence

_SLOWEST_FIRST = ("controller", "systemd", "faults", "vcan")


class Dispatcher:
    """Sends the collected tests into kernels, and their reports to pytest."""

    def __init__(self, *, only_qemu: bool) -> None:
        """Begin with an empty ledger."""
        self._only_qemu = only_qemu
        self._kinds = dict(KINDS)
        self.ledger = Ledger()

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
            self.ledger.ran["this machine's own", "vcan"] += 1
        try:
            away = self._that_can_run(session, [item for item in session.items if item not in here])
            again = self._run(session, away, os.cpu_count() or 1, last=False)
            again = self._run(session, again, 1, last=False)
            self._run(session, again, 1, last=True)
        except CannotFetchError as error:
            pytest.exit(str(error), returncode=3)
        why = self.ledger.why_incomplete()
        if why:
            pytest.exit(why, returncode=3)
        return True

    def _that_can_run(self, session: pytest.Session, items: list[pytest.Item]) -> list[pytest.Item]:
        """Return the items that run: the short form where user-mode Linux cannot run, all of them elsewhere."""
        wanted = [item for item in items if not KINDS[_kind(item)].emulated]
        if not wanted:
            return items
        why = "it was asked for (--kernel=qemu)" if self._only_qemu else fleet.why_user_mode_cannot_run(KINDS["vcan"])
        if not why:
            return items
        self._kinds = {name: kind.in_qemu() for name, kind in KINDS.items()}
        left_out = [item for item in wanted if item.get_closest_marker("short_form") is None]
        self.ledger.takes_short_form(why, [item.nodeid for item in left_out])
        session.config.hook.pytest_deselected(items=left_out)
        return [item for item in items if item not in left_out]

    def _run(
        self, session: pytest.Session, items: Sequence[pytest.Item], at_once: int, *, last: bool
    ) -> list[pytest.Item]:
        """Run `items`; return those that failed or never began, which the last try reports instead."""
        by_id = {item.nodeid: item for item in items}
        reports: dict[str, list[pytest.TestReport]] = defaultdict(list)
        again: list[pytest.Item] = []
        if any(KINDS[_kind(item)].booted for item in items):
            wheels.fetch()
        for guest, data in fleet.run(self._groups(items), at_once):
            if data is not None:
                report = _unskipped(
                    session.config.hook.pytest_report_from_serializable(config=session.config, data=data)
                )
                reports[report.nodeid].append(report)
                if report.when == "teardown":
                    self._report(by_id[report.nodeid], guest, reports[report.nodeid], again, last=last)
                continue
            why = guest.why_it_never_began()
            if why:
                self.ledger.never_began(guest, why, last=last)
                again += [by_id[nodeid] for nodeid in guest.group.tests]
                continue
            for nodeid in guest.group.tests:
                if not any(report.when == "teardown" for report in reports[nodeid]):
                    reports[nodeid].append(_died(by_id[nodeid], guest))
                    # another try would take as long again
                    self._report(by_id[nodeid], guest, reports[nodeid], again, last=last or guest.is_overdue)
        return again

    def _report(
        self,
        item: pytest.Item,
        guest: fleet.Guest,
        reports: Sequence[pytest.TestReport],
        again: list[pytest.Item],
        *,
        last: bool,
    ) -> None:
        """Hand the reports of one test to pytest, or keep it for another try."""
        bad = next((report for report in reports if report.failed), None)
        if bad is not None and not last:
            again.append(item)
            self.ledger.more_tries.append(f"{item.nodeid}\n{bad.longreprtext}")
            return
        self.ledger.ran[guest.kernel, guest.group.kind_name] += 1
        item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
        for report in reports:
            item.ihook.pytest_runtest_logreport(report=report)
        item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)

    def _groups(self, items: Sequence[pytest.Item]) -> list[fleet.Group]:
        """Return the items of each file and kind as a group, the slowest kinds first."""
        groups: dict[tuple[str, str], list[str]] = defaultdict(list)
        for item in items:
            groups[_kind(item), item.path.stem].append(item.nodeid)
        order = sorted(groups, key=lambda key: (_SLOWEST_FIRST.index(key[0]), key[1]))
        return [fleet.Group(kind, self._kinds[kind], f"{kind}-{stem}", groups[kind, stem]) for kind, stem in order]

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        """Show which kernel ran what, what did not run, and what needed another try: nothing is hidden."""
        for title, lines in self.ledger.sections():
            terminalreporter.section(title)
            for line in lines:
                terminalreporter.line(line)


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


def _died(item: pytest.Item, guest: fleet.Guest) -> pytest.TestReport:
    text = f"the kernel ended before this test did\n{guest.last_words()}"
    return pytest.TestReport(item.nodeid, item.location, {}, "failed", text, "call")


def _unskipped(report: pytest.TestReport) -> pytest.TestReport:
    """Return the report, as a failure where it was skipped: in a kernel made for a test nothing is missing."""
    if report.skipped:
        report.outcome = "failed"
        report.longrepr = f"skipped inside its kernel: {report.longrepr}"
    return report
