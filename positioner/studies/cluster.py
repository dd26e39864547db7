"""A Dask cluster as the pool of a study: its nodes need nothing but this package, in the same version. Shell.

Dask gives the work of a node that died to another one. A result that only the dead node held is computed again.
"""

from __future__ import annotations

import logging
import platform
from concurrent.futures import CancelledError
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from typing import TYPE_CHECKING, Any, TypeVar

from positioner.errors import BenchError, UsageError, shortened
from positioner.inputs.plug_in import Kind
from positioner.inputs.plug_in_digest import plug_in_digest
from positioner.laws.registry import is_outside
from positioner.studies.code_digest import own_code, whole_digest

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterator, Sequence

T = TypeVar("T")
R = TypeVar("R")

INSTALL = "Dask is not installed: pip install 'sticking-valve-positioner[dask]'"
_ANSWERS_WITHIN_S = 10.0
_AHEAD = 4
"""Items at the cluster for each thread: a node always has the next one, and the scheduler never has all of them."""


@contextmanager
def connected(address: str) -> Iterator[Cluster]:
    """Hold a connection to the scheduler at `address` inside a `with` block.

    Raises:
        UsageError: Dask is not installed, or there is no such kind of address.
        BenchError: no scheduler answers, it has no workers, or the package is not installed there.
    """
    try:
        from distributed import Client  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise UsageError(INSTALL) from error
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)  # our one line stands for its tracebacks
    try:
        client = Client(address, timeout=_ANSWERS_WITHIN_S, set_as_default=False)
    except OSError as error:  # a TimeoutError is one
        raise BenchError(f"--dask {address}: no scheduler answers there within {_ANSWERS_WITHIN_S:g} s") from error
    except ValueError as error:
        raise UsageError(f"--dask {address}: {error}; write it like tcp://192.0.2.1:8786") from error
    with client:
        cluster = Cluster(client, address)
        if not cluster.size:
            raise BenchError(f"--dask {address}: the cluster has no workers yet: dask worker {address} --nthreads 1")
        try:
            client.submit(whole_digest, pure=False).result()
        except (ImportError, RuntimeError) as error:
            what = "the scheduler or a worker cannot import this package: install it on every node"
            raise BenchError(f"--dask {address}: {what} ({shortened(str(error.__cause__ or error))})") from error
        yield cluster


@dataclass(frozen=True, slots=True)
class Cluster:
    """The workers of a scheduler; they may come and go."""

    client: Any
    address: str

    @property
    def size(self) -> int:
        """How many items they work on at the same time."""
        return sum(self.client.nthreads().values())

    def results(self, function: Callable[[T], R], items: Sequence[T]) -> Generator[tuple[T, R]]:
        """Yield each item with the result of `function`, in the order of completion.

        Raises:
            BenchError: a worker has other code, an item killed several workers, or the scheduler is gone.
        """
        from distributed import KilledWorker, as_completed  # noqa: PLC0415 - an extra

        rest = iter(items)
        waiting: dict[Any, T] = {}

        def more() -> list[Any]:
            room = max(_AHEAD * self.size, 1) - len(waiting)  # with one item it waits for workers to come back
            futures = {
                self.client.submit(_run, _code_of(item), function, item, pure=False): item
                for item in islice(rest, max(room, 0))
            }
            waiting.update(futures)
            return list(futures)

        completed = as_completed(more(), loop=self.client.loop)
        try:
            for future in completed:
                yield waiting.pop(future), future.result()
                future.release()
                for following in more():
                    completed.add(following)
        except KilledWorker as error:
            raise BenchError(f"--dask {self.address}: one item killed several workers (too little memory?)") from error
        except (CancelledError, OSError) as error:
            raise BenchError(f"--dask {self.address}: the connection to the scheduler is lost") from error
        finally:
            self.client.cancel(list(waiting))


def _run(code: str, function: Callable[[T], R], item: T) -> R:
    """Return the result of `function`, on a worker.

    Raises:
        BenchError: this worker has other code than the study.
    """
    if code != _code_of(item):
        what = "this package, or of a law or a plant from outside"
        raise BenchError(f"--dask: the worker on {platform.node()} has another version of {what}: update it")
    return function(item)


def _code_of(item: object) -> str:
    """Return a digest of all code that an item may run; its law, and the physics of its plant, may be from outside."""
    law = getattr(item, "law", None)
    of_law = plug_in_digest(Kind.LAW, law) if isinstance(law, str) and is_outside(law) else ""
    return whole_digest() + of_law + own_code(item)
