"""Playing a campaign: nothing twice and nothing lost, whatever was killed when."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from dask_cluster import dask_cluster
from slow_cases import slow
from small import STARTED, counted, rows, small, started

from positioner.campaign import study
from positioner.campaign.journal import Journal
from positioner.campaign.run import Outcome, Run, outcome_of, play
from positioner.campaign.study import JOURNAL, play_campaign
from positioner.campaign.table import write_table
from positioner.errors import AlreadyRunningError
from positioner.store import lock
from positioner.studies.pool import Workers

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Sequence

    from positioner.campaign.plan import Campaign


@pytest.fixture(autouse=True)
def counter(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(STARTED, str(tmp_path / "started"))


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Play in this process, in the reverse order."""

    def instead(
        function: Callable[[Run], Outcome], items: Sequence[Run], _workers: Workers
    ) -> Generator[tuple[Run, Outcome]]:
        yield from ((item, function(item)) for item in reversed(items))

    monkeypatch.setattr(study, "spread_out", instead)


def keys(campaign: Campaign) -> list[str]:
    return [run.key for run in campaign.runs()]


@pytest.mark.usefixtures("here")
def test_a_finished_campaign_plays_nothing_again_and_has_the_same_rows(tmp_path: Path) -> None:
    campaign = small(tmp_path)
    first = play_campaign(campaign, tmp_path / "out", function=counted)
    assert sorted(started()) == sorted(keys(campaign))
    assert [(each.run.point, each.run.seed) for each in first] == [(n, seed) for n in range(4) for seed in (1, 2)]
    assert play_campaign(campaign, tmp_path / "out", function=counted) == first
    assert len(started()) == 8


@pytest.mark.usefixtures("here")
def test_a_longer_campaign_plays_only_what_is_new(tmp_path: Path) -> None:
    first = play_campaign(small(tmp_path), tmp_path / "out", function=counted)
    longer = small(tmp_path, points="points = 8", seeds="seeds = [1, 2, 3]")
    played = play_campaign(longer, tmp_path / "out", function=counted)
    assert len(played) == 24
    assert sorted(started()) == sorted(keys(longer))  # each once
    assert [each for each in played if each.run.point < 4 and each.run.seed < 3] == first


@pytest.mark.usefixtures("here")
def test_runs_of_other_code_are_played_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    campaign = small(tmp_path)
    play_campaign(campaign, tmp_path / "out", function=counted)
    monkeypatch.setattr(study, "code_of", lambda law: f"of tomorrow, {law}")
    play_campaign(campaign, tmp_path / "out", function=counted)
    assert sorted(started()) == sorted(2 * keys(campaign))


@pytest.mark.usefixtures("here")
def test_points_that_differ_in_nothing_are_one_run(tmp_path: Path) -> None:
    campaign = small(tmp_path, seeds="seeds = [1, 1]")
    assert len(play_campaign(campaign, tmp_path / "out", function=counted)) == len(started()) == 4


def test_a_journal_that_was_cut_at_any_byte_holds_its_whole_lines_and_goes_on(tmp_path: Path) -> None:
    path, outcome = tmp_path / JOURNAL, Outcome(None, "failed, with a ’ in its text")
    with Journal(path, outcome_of) as journal:
        for key in "abc":
            journal.add(key, "code", outcome)
    content = path.read_bytes()
    for length in range(len(content) + 1):
        path.write_bytes(content[:length])
        whole = content[:length].count(b"\n")
        with Journal(path, outcome_of) as journal:
            assert [journal.outcome(key, "code") for key in "abc"] == [outcome] * whole + [None] * (3 - whole)
            for key in "abc"[whole:]:
                journal.add(key, "code", outcome)
        assert path.read_bytes() == content


def test_a_damaged_line_is_played_again_and_the_others_stay(tmp_path: Path) -> None:
    path = tmp_path / JOURNAL
    with Journal(path, outcome_of) as journal:
        for key in "abc":
            journal.add(key, "code", Outcome(None, key))
    lines = path.read_bytes().splitlines(keepends=True)
    for damage in (
        b"\x00\xff\n",
        b"{}\n",
        b"[1]\n",
        b'{"run": "b", "code": "code", "figures": {"x": 1}, "failure": 0}\n',
    ):
        path.write_bytes(lines[0] + damage + lines[2])
        with Journal(path, outcome_of) as journal:
            assert [journal.outcome(key, "code") for key in "abc"] == [Outcome(None, "a"), None, Outcome(None, "c")]


@pytest.mark.parametrize("when", ["in a line", *slow("in a run", "before a line", "after a line", "in the table")])
def test_a_campaign_that_is_killed_continues_without_a_run_twice(tmp_path: Path, when: str) -> None:
    campaign, out = small(tmp_path), tmp_path / "out"
    program = [sys.executable, str(Path(__file__).with_name("killed.py")), campaign.source, str(out), when]
    # its end is that of its workers, too: they hold its output
    killed = subprocess.run(program, check=False, capture_output=True, text=True, timeout=300.0)
    assert killed.returncode == -signal.SIGKILL, killed.stderr
    assert not (out / "runs.parquet").exists()
    kept = [json.loads(line)["run"] for line in (out / JOURNAL).read_bytes().split(b"\n")[:-1]]
    assert len(kept) == {"before a line": 2, "in a line": 2, "after a line": 3, "in the table": 8}.get(when, len(kept))
    before = started()
    played = play_campaign(campaign, out, Workers(1), counted)
    again = started()[len(before) :]
    assert sorted(kept + again) == sorted(keys(campaign))  # all, and none of them twice
    write_table(out / "runs.parquet", campaign, played)
    undisturbed = play_here(campaign, tmp_path / "undisturbed")
    assert rows(out / "runs.parquet") == rows(undisturbed)


def play_here(campaign: Campaign, out: Path) -> Path:
    """Return the Parquet file of the campaign, played in this process."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study, "spread_out", lambda function, items, _: ((item, function(item)) for item in items))
        played = play_campaign(campaign, out)
    write_table(out / "runs.parquet", campaign, played)
    return out / "runs.parquet"


def test_a_worker_that_is_killed_on_a_cluster_changes_no_row(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    campaign, out = small(tmp_path), tmp_path / "out"
    add, kept = Journal.add, []

    with dask_cluster(tmp_path / "dask") as cluster:

        def then_kill(self: Journal[Outcome], key: str, code: str, outcome: Outcome) -> None:
            add(self, key, code, outcome)
            kept.append(key)
            if len(kept) == 3:
                cluster.workers[0].kill()

        monkeypatch.setattr(Journal, "add", then_kill)
        played = play_campaign(campaign, out, Workers(dask=cluster.address))
        assert cluster.workers[0].wait(60.0) == -signal.SIGKILL
        assert cluster.workers[1].poll() is None
    assert sorted(kept) == sorted(keys(campaign))
    write_table(out / "runs.parquet", campaign, played)
    monkeypatch.undo()
    assert rows(out / "runs.parquet") == rows(play_here(campaign, tmp_path / "undisturbed"))


def test_two_campaigns_do_not_write_into_one_directory(tmp_path: Path) -> None:
    campaign = small(tmp_path)
    (tmp_path / "out").mkdir()
    with lock.held(tmp_path / "out", timeout_s=0.0), pytest.raises(AlreadyRunningError, match="out: in use by process"):
        play_campaign(campaign, tmp_path / "out")


def test_a_run_is_a_function_of_its_scenario(tmp_path: Path) -> None:
    run = next(small(tmp_path).runs())
    assert play(run) == play(run)
    assert play(run).figures is not None


def test_a_run_that_fails_has_a_reason_and_ends_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_: object) -> None:
        raise ZeroDivisionError("at this end of the range")

    monkeypatch.setattr("positioner.campaign.run.run_in_process", fail)
    assert play(next(small(tmp_path).runs())) == Outcome(None, "ZeroDivisionError: at this end of the range")
