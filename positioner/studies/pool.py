"""Work for all cores or for a cluster: results in the order of completion, nothing left when it is stopped. Shell.

A study hands over a function and its items, and does not know where they run. Function and items must be importable and
picklable; a result must depend on nothing but its item.
"""

from __future__ import annotations

import os
import signal
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager
from dataclasses import dataclass
from multiprocessing import active_children, connection, get_context, parent_process
from threading import Thread
from typing import TYPE_CHECKING, Protocol, TypeVar

from positioner.errors import BenchError, UsageError

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterator, Sequence

T = TypeVar("T")
R = TypeVar("R")


@dataclass(frozen=True, slots=True)
class Workers:
    """Where a study runs: in `count` processes of this machine, None for one a core, or on the Dask cluster `dask`."""

    count: int | None = None
    dask: str | None = None


EVERY_CORE = Workers()


class Pool(Protocol):
    """Workers that run; the end of the `with` block of `opened` ends them."""

    @property
    def size(self) -> int:
        """How many items they work on at the same time."""

    def results(self, function: Callable[[T], R], items: Sequence[T]) -> Generator[tuple[T, R]]:
        """Yield each item with the result of `function`, in the order of completion.

        Raises:
            BenchError: a worker died, or a node of the cluster cannot be used.
        """


@contextmanager
def opened(workers: Workers) -> Iterator[Pool]:
    """Hold a pool of `workers` inside a `with` block.

    Raises:
        UsageError: fewer than one worker, or Dask is not installed.
        BenchError: the cluster does not answer, or has no workers.
    """
    if workers.dask is not None:
        from positioner.studies.cluster import connected  # noqa: PLC0415 - Dask is an extra

        with connected(workers.dask) as cluster:
            yield cluster
        return
    if workers.count is not None and workers.count < 1:
        raise UsageError(f"--workers {workers.count}: at least 1 is needed")
    context = get_context("spawn")  # a fork would copy the state of the solver and of threads
    size = workers.count or os.cpu_count() or 1
    with ProcessPoolExecutor(size, mp_context=context, initializer=_belong_to_the_parent) as executor:
        yield _Processes(executor, size)


def spread_out(function: Callable[[T], R], items: Sequence[T], workers: Workers) -> Generator[tuple[T, R]]:
    """Yield as `Pool.results` from a pool for these items alone.

    Raises:
        UsageError: as `opened`.
        BenchError: as `opened` and `Pool.results`.
    """
    with opened(workers) as pool, closing(pool.results(function, items)) as results:
        yield from results


@dataclass(frozen=True, slots=True)
class _Processes:
    """Processes of this machine."""

    executor: ProcessPoolExecutor
    size: int

    def results(self, function: Callable[[T], R], items: Sequence[T]) -> Generator[tuple[T, R]]:
        waiting = {self.executor.submit(function, item): item for item in items}
        try:
            for future in as_completed(waiting):
                yield waiting[future], future.result()
        except BrokenProcessPool as error:
            raise BenchError("a worker was killed (too little memory?): try again with fewer --workers") from error
        except BaseException:  # usually an interrupt: nobody waits for the results any more
            for child in active_children():  # without its workers the pool ends
                child.terminate()
            raise


def _belong_to_the_parent() -> None:
    """Leave Ctrl-C, which reaches every process of a terminal, to the parent, and end when the parent was killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = parent_process()
    if parent is not None:
        Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


def _end_with(sentinel: int) -> None:
    connection.wait([sentinel])
    os._exit(1)
