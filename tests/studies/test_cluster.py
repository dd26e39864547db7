"""Studies on a Dask cluster: the same results, also when a worker dies, and one line for all that can go wrong."""

from __future__ import annotations

import math
import os
import signal
import sys
import types
from dataclasses import fields
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import pytest
from dask_cluster import dask_cluster

from positioner.cli.main import main
from positioner.errors import BenchError, ExitCode, UsageError
from positioner.studies import cluster, tuning
from positioner.studies import reproduce as reproduction
from positioner.studies.interpretations import Interpretation, NoiseKind, Units
from positioner.studies.pool import Workers, opened, spread_out

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with dask_cluster(tmp_path_factory.mktemp("dask")) as started:
        yield started.address


def die_in_place_of(folder: Path, item: int) -> int:
    """Kill the worker that is the first to come here, and answer on every other one."""
    try:
        (folder / "died").touch(exist_ok=False)
    except FileExistsError:
        return item * item
    os.kill(os.getpid(), signal.SIGKILL)
    return 0


def fail(item: int) -> int:
    raise ArithmeticError(f"no square of {item}")


def test_every_item_comes_back_with_its_result_though_they_are_more_than_the_cluster_holds(address: str) -> None:
    with opened(Workers(dask=address)) as pool:
        assert pool.size == 2
        for _ in range(2):  # a pool serves several times
            assert dict(pool.results(math.factorial, range(50))) == {n: math.factorial(n) for n in range(50)}


def test_a_cluster_that_loses_all_its_workers_for_a_while_loses_no_item(
    address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with opened(Workers(dask=address)) as pool:
        monkeypatch.setattr(cluster.Cluster, "size", 0)
        assert dict(pool.results(math.factorial, range(5))) == {n: math.factorial(n) for n in range(5)}


def test_an_error_of_the_work_is_the_error_of_the_study(address: str) -> None:
    with pytest.raises(ArithmeticError, match="no square of 3"):
        list(spread_out(fail, (3,), Workers(dask=address)))


def test_a_worker_with_other_code_is_refused(address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "whole_digest", lambda: "of yesterday")
    with pytest.raises(BenchError, match="has another version of this package"):
        list(spread_out(math.factorial, (3,), Workers(dask=address)))


def test_a_worker_that_is_killed_costs_nothing_but_time(tmp_path: Path) -> None:
    with dask_cluster(tmp_path) as started:
        work = partial(die_in_place_of, tmp_path)
        found = dict(spread_out(work, range(9), Workers(dask=started.address)))
        assert found == {n: n * n for n in range(9)}
        assert sorted(worker.poll() is None for worker in started.workers) == [False, True]


def test_a_cluster_without_workers_says_how_to_start_one(tmp_path: Path) -> None:
    with (
        dask_cluster(tmp_path, workers=0) as started,
        pytest.raises(BenchError, match="has no workers yet: dask worker tcp://"),
    ):
        list(spread_out(math.factorial, (3,), Workers(dask=started.address)))


def test_a_scheduler_that_is_killed_is_one_line(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    with dask_cluster(tmp_path, workers=1) as started:
        results = spread_out(math.factorial, range(200), Workers(dask=started.address))
        next(results)
        started.scheduler.kill()
        with pytest.raises(BenchError, match="the connection to the scheduler is lost"):
            list(results)
    assert "Traceback" not in capfd.readouterr().err


def test_a_cluster_that_cannot_import_the_work_is_one_line(address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    stranger = types.ModuleType("stranger")
    exec("def digest(): pass", vars(stranger))  # noqa: S102 - a function of a module that only this process has
    monkeypatch.setitem(sys.modules, "stranger", stranger)
    monkeypatch.setattr(cluster, "whole_digest", stranger.digest)
    with pytest.raises(BenchError, match=r"cannot import this package: install it on every node .*'stranger'"):
        list(spread_out(math.factorial, (3,), Workers(dask=address)))


def test_an_address_where_nobody_answers_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "_ANSWERS_WITHIN_S", 0.1)
    with pytest.raises(BenchError, match=r"--dask tcp://127.0.0.1:1: no scheduler answers"):
        list(spread_out(math.factorial, (3,), Workers(dask="tcp://127.0.0.1:1")))


def test_an_address_of_an_unknown_kind_is_one_line() -> None:
    with pytest.raises(UsageError, match="--dask pigeon://loft: "):
        list(spread_out(math.factorial, (3,), Workers(dask="pigeon://loft")))


def test_a_machine_without_dask_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    for command in (["league", "--short"], ["reproduce", "--short"], ["tune", "pi"]):
        arguments = [*command, "--dask", "tcp://127.0.0.1:1", "--out", str(tmp_path / "out")]
        assert main(arguments) == ExitCode.USAGE
        assert "Dask is not installed: pip install 'sticking-valve-positioner[dask]'" in capsys.readouterr().err


def test_a_study_runs_here_or_on_a_cluster(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["league", "--workers", "2", "--dask", "tcp://127.0.0.1:1"])
    assert "not allowed with argument --workers" in capsys.readouterr().err


def test_a_simulation_of_the_paper_is_the_same_on_a_cluster(address: str) -> None:
    run = reproduction.Run(2, Interpretation(NoiseKind.FREE, Units.SI), short=True)
    (there,) = reproduction.reproduce((run,), Workers(dask=address))
    here = reproduction.play(run)
    assert (there.run, there.before, there.after) == (run, here.before, here.after)
    for each in fields(here.curves):
        np.testing.assert_array_equal(getattr(there.curves, each.name), getattr(here.curves, each.name))


def test_the_league_and_the_tuning_are_the_same_on_a_cluster(
    address: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tuning, "VISITS", 1)
    monkeypatch.setattr(tuning, "DWELL_S", 0.05)
    league = ["league", "--laws", "pi", "--plants", "paper", "--seeds", "1,2", "--setpoints", "75", "--dwell", "0.05"]
    for where in (["--workers", "1"], ["--dask", address]):
        assert main([*league, *where, "--out", str(tmp_path / where[0])]) == ExitCode.OK
        assert main(["tune", "two-move", "--budget", "2", *where, "--out", str(tmp_path / where[0] / "tuned")]) == 0
    for name in ("league.json", "tuned"):
        assert (tmp_path / "--dask" / name).read_bytes() == (tmp_path / "--workers" / name).read_bytes()
