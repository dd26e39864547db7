"""The health of a valve computed again from a log, cycle by cycle as the daemon computed it. Shell."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tqdm import tqdm

from positioner.health.monitor import begin_health, observe
from positioner.inputs.plain_file import MOST_MIB
from positioner.replay.compare import Comparison
from positioner.replay.log import LogError
from positioner.replay.prepare import prepare
from positioner.replay.recorded import first_in
from positioner.replay.run import replay_cycles
from positioner.wire.messages import Health, Mode, PositionerStatus

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from pathlib import Path
    from typing import Any

    from positioner.config.schema import Configuration
    from positioner.health.monitor import HealthSettings, HealthState
    from positioner.wire.codec import Codec
    from positioner.wire.messages import CanFrame


def health_in(
    path: Path,
    configuration: Configuration,
    settings: HealthSettings,
    state: Path | None,
    sections: Mapping[str, Any],
    most_mib: int = MOST_MIB,
) -> tuple[HealthState, tuple[str, ...]]:
    """Return the health after the log, and lines about what makes it inexact.

    It begins with the table in `state`, which is only read, and with the kept `sections`.

    Raises:
        LogError: the log cannot be read, begins after the positioner, or holds a test procedure, which the law cannot
            play again: its health was counted while it ran.
        StateError: the table cannot be read.
        ValueError: the sections are not as they were written.
    """
    prepared = prepare(path, configuration, state, most_mib)
    if prepared.late:
        raise LogError(f"{path}: starts late: {prepared.late}: start the log before the positioner")
    health = begin_health(settings, sections)
    codec = configuration.make_codec()
    comparison = Comparison(codec, prepared.kind.has_instants)
    cycles = replay_cycles(configuration, prepared.cycles(), prepared.table)
    for cycle in tqdm(cycles, "health", prepared.cycle_count, unit=" cycles", delay=1, leave=False, disable=None):
        if _is_of_procedure(codec, (logged.frame for logged in cycle.recorded.outbox)):
            raise LogError(f"{path}: holds a test procedure, whose health was counted while it ran: positioner health")
        comparison.add(cycle)
        if cycle.observed is not None:
            observe(settings, health, cycle.observed)
    lines = list(prepared.warnings)
    if not comparison.identical:
        lines.append("computed frames differ from the recorded ones, so counts may, too: see positioner replay")
    if not prepared.kind.has_instants:
        lines.append("a log of the bus has no instants of the cycles: times are nearly those of the positioner")
    return health, tuple(lines)


def _is_of_procedure(codec: Codec, frames: Iterable[CanFrame]) -> bool:
    """Return whether a status among these frames is of a positioner whose valve a test procedure moves."""
    status, _ = first_in(codec, PositionerStatus, frames) or (None, None)
    return status is not None and status.mode is Mode.ACTIVE and status.health is Health.FUNCTION_CHECK
