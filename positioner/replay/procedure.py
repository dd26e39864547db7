"""A test procedure run again on its own record: the same observations, and so the same memory at its end. Shell."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

from tqdm import tqdm

from positioner.commissioning.procedure import commissioning_setup
from positioner.replay.compare import Comparison
from positioner.replay.log import LogError
from positioner.replay.prepare import prepare
from positioner.replay.run import replay_cycles

if TYPE_CHECKING:
    from pathlib import Path

    from positioner.commissioning.procedure import Procedure, Progress
    from positioner.config.schema import Configuration
    from positioner.laws.law import Observation

M = TypeVar("M")


class _Kept:
    """A procedure whose newest memory is kept."""

    def __init__(self, procedure: Procedure[Any]) -> None:
        self._procedure = procedure
        self.name = procedure.name
        self.memory: Any = None

    def begin(self, measured_m: float) -> Any:
        return self._procedure.begin(measured_m)

    def advance(self, memory: Any, observation: Observation) -> tuple[Any, float]:
        self.memory, current_ma = self._procedure.advance(memory, observation)
        return self.memory, current_ma

    def progress(self, memory: Any) -> Progress:
        return self._procedure.progress(memory)

    def abort(self, memory: Any, why: str) -> Any:
        return self._procedure.abort(memory, why)


def memory_in(path: Path, configuration: Configuration, procedure: Procedure[M]) -> M:
    """Return the memory at its end of the procedure whose frames are in the log at `path`.

    Raises:
        LogError: the log cannot be read, or is no complete record of this procedure with this configuration.
    """
    prepared, kept = prepare(path, configuration, None), _Kept(procedure)
    comparison = Comparison(configuration.make_codec(), prepared.kind.has_instants)
    setup = commissioning_setup(configuration.make_setup(), kept)
    cycles = replay_cycles(configuration, prepared.cycles(), prepared.table, setup=setup)
    for cycle in tqdm(cycles, "log", prepared.cycle_count, unit=" cycles", delay=1, leave=False, disable=None):
        comparison.add(cycle)
    memory: M | None = kept.memory
    if memory is None or not comparison.identical:
        raise LogError(
            f"{path}: holds other commands than {procedure.name} gives with this configuration: not its record"
        )
    progress = procedure.progress(memory)
    if progress.aborted or not progress.ended:
        reason = progress.aborted or f"it ends while {progress.doing}"
        raise LogError(f"{path}: the {procedure.name} in it was not completed: {reason}")
    return memory
