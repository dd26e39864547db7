"""Work for all cores: results in the order of completion, and no process left when it is stopped. Shell."""

from __future__ import annotations

import os
import signal
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import active_children, get_context
from typing import TYPE_CHECKING, TypeVar

from positioner.errors import BenchError, UsageError

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Sequence

T = TypeVar("T")
R = TypeVar("R")


def spread_out(function: Callable[[T], R], items: Sequence[T], workers: int | None) -> Generator[tuple[T, R]]:
    """Yield each item with the result of `function`, in the order of completion; `workers` None: one for each core.

    Raises:
        UsageError: fewer than one worker.
        BenchError: a worker died.
    """
    if workers is not None and workers < 1:
        raise UsageError(f"--workers {workers}: at least 1 is needed")
    context = get_context("spawn")  # a fork would copy the state of the solver and of threads
    with ProcessPoolExecutor(workers or os.cpu_count(), mp_context=context, initializer=_ignore_interrupts) as pool:
        waiting = {pool.submit(function, item): item for item in items}
        try:
            for future in as_completed(waiting):
                yield waiting[future], future.result()
        except BrokenProcessPool as error:
            raise BenchError("a worker was killed (too little memory?): try again with fewer --workers") from error
        except BaseException:  # usually an interrupt: nobody waits for the results any more
            for child in active_children():  # without its workers the pool ends
                child.terminate()
            raise


def _ignore_interrupts() -> None:
    """Ctrl-C reaches every process of a terminal; only the one that started the workers reacts."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
