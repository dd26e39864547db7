"""A campaign in a process of its own, killed with kill -9 at an instant of choice: arguments FILE, OUT, WHEN."""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, NoReturn

from small import counted, started

from positioner.campaign.journal import Journal
from positioner.campaign.reader import load_campaign
from positioner.campaign.study import play_campaign
from positioner.campaign.table import write_table
from positioner.studies.pool import Workers

if TYPE_CHECKING:
    from collections.abc import Callable

    from positioner.campaign.run import Outcome, Run

RUN = 3
"""At this run, counted from 1."""


def die() -> NoReturn:
    os.kill(os.getpid(), signal.SIGKILL)
    raise AssertionError("still alive")


def kill_the_study(run: Run) -> Outcome:
    outcome = counted(run)
    if len(started()) == RUN:
        os.kill(os.getppid(), signal.SIGKILL)
    return outcome


def at_journal(before: Callable[[BinaryIO, bytes], None], after: Callable[[], None]) -> None:
    """Do something before and after the line of a run is written."""
    add = Journal.add
    added = 0

    def instead(self: Journal[Outcome], key: str, code: str, outcome: Outcome) -> None:
        nonlocal added
        added += 1
        if added == RUN:
            before(self._file, f'{{"run": "{key}", "code'.encode())
        add(self, key, code, outcome)
        if added == RUN:
            after()

    Journal.add = instead  # type: ignore[method-assign,assignment]


def half_a_line(file: BinaryIO, line: bytes) -> None:
    file.write(line)
    file.flush()
    die()


def main() -> None:
    file, out, when = Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3]
    function = counted
    match when:
        case "in a run":
            function = kill_the_study
        case "before a line":
            at_journal(lambda _file, _line: die(), lambda: None)
        case "in a line":
            at_journal(half_a_line, lambda: None)
        case "after a line":
            at_journal(lambda _file, _line: None, die)
        case "in the table":
            Path.replace = lambda _path, _target: die()  # type: ignore[assignment,method-assign]
    campaign = load_campaign(file)
    played = play_campaign(campaign, out, Workers(1), function)
    write_table(out / "runs.parquet", campaign, played)


if __name__ == "__main__":
    main()
