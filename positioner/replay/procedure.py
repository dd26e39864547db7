"""A test procedure run again on its own record: the same observations, and so the same memory at its end. Shell."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

from tqdm import tqdm

from positioner.commissioning.procedure import aborted_by, commissioning_setup, ended_by, procedure_law
from positioner.inputs.plain_file import MOST_MIB
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
    """A procedure whose newest memory is kept, and which is aborted before its next observation where `why` is set."""

    def __init__(self, procedure: Procedure[Any]) -> None:
        self._procedure = procedure
        self.name = procedure.name
        self.memory: Any = None
        self.why = ""

    def begin(self, measured_m: float) -> Any:
        return self._procedure.begin(measured_m)

    def advance(self, memory: Any, observation: Observation) -> tuple[Any, float]:
        if self.why:
            memory = self._procedure.abort(memory, self.why)
        self.memory, current_ma = self._procedure.advance(memory, observation)
        return self.memory, current_ma

    def progress(self, memory: Any) -> Progress:
        return self._procedure.progress(memory)

    def abort(self, memory: Any, why: str) -> Any:
        return self._procedure.abort(memory, why)


def memory_in(path: Path, configuration: Configuration, procedure: Procedure[M], most_mib: int = MOST_MIB) -> M:
    """Return the memory at its end of the procedure whose frames are in the log at `path`.

    Raises:
        LogError: the log cannot be read, or is no complete record of this procedure with this configuration.
    """
    memory, _ = outcome_in(path, configuration, procedure, most_mib)
    progress = procedure.progress(memory)
    if progress.aborted or not progress.ended:
        reason = progress.aborted or f"it ends while {progress.doing}"
        raise LogError(f"{path}: the {procedure.name} in it was not completed: {reason}")
    return memory


def outcome_in(
    path: Path, configuration: Configuration, procedure: Procedure[M], most_mib: int = MOST_MIB
) -> tuple[M, str]:
    """Return the memory as `memory_in`, also where it was ended before its time, and how the guard ended it.

    Raises:
        LogError: the log cannot be read, or is no record of this procedure with this configuration.
    """
    prepared, kept, ended = prepare(path, configuration, None, most_mib), _Kept(procedure), ""
    comparison = Comparison(configuration.make_codec(), prepared.kind.has_instants)
    law = procedure_law(kept, configuration.valve, configuration.guard)
    setup = commissioning_setup(configuration.make_setup(law=law), kept)
    cycles = replay_cycles(configuration, prepared.cycles(), prepared.table, setup=setup)
    for cycle in tqdm(cycles, "log", prepared.cycle_count, unit=" cycles", delay=1, leave=False, disable=None):
        comparison.add(cycle)
        if kept.memory is not None and not ended:
            ended = ended_by(cycle.mode, cycle.cause)
            kept.why = kept.why or aborted_by(cycle.mode, cycle.cause)
    memory: M | None = kept.memory
    if memory is None or not comparison.identical:
        raise LogError(
            f"{path}: holds other commands than {procedure.name} gives with this configuration: not its record"
        )
    return (procedure.abort(memory, kept.why) if kept.why else memory), ended
