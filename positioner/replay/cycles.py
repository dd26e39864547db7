"""The positioner's cycles in a log: the instant of each cycle, and the frames that it received and sent. Pure.

There are three kinds of log (DESIGN.md, "Replay"). The positioner's own record has the instants and the order of the
frames. In the log of a lockstep bench, all frames of a sample have the sample's time. In any other log, the counters
that a command echoes show which frames the positioner had received, and the command's time stamp is the instant.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.replay.echoes import bus_cycles
from positioner.replay.recorded import MOST_FRAMES, FrameClassifier, RecordedCycle
from positioner.replay.survey import LogKind, snapped
from positioner.runtime.record import NOTE_ID

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from positioner.replay.log import LogFrame


def cycles_of(
    kind: LogKind, classifier: FrameClassifier, frames: Iterable[LogFrame], period_ns: int
) -> Iterator[RecordedCycle]:
    """Yield the cycles in the frames of a log of this kind; `period_ns` is the sample period."""
    concerning = (frame for frame in frames if classifier.concerns(frame))
    match kind:
        case LogKind.RECORD:
            return _recorded_cycles(classifier, concerning)
        case LogKind.LOCKSTEP:
            return _lockstep_cycles(classifier, concerning, period_ns)
        case LogKind.BUS:
            return bus_cycles(classifier, concerning, period_ns)


def _recorded_cycles(classifier: FrameClassifier, frames: Iterable[LogFrame]) -> Iterator[RecordedCycle]:
    """Yield a cycle for each instant; a frame received after a sent one begins the next cycle."""

    def begins(run: list[LogFrame], frame: LogFrame) -> bool:
        return frame.time_ns != run[0].time_ns or (_is_sent(run[-1]) and not _is_sent(frame))

    return (_recorded_cycle(classifier, run) for run in _runs(frames, begins))


def _runs(
    frames: Iterable[LogFrame], begins: Callable[[list[LogFrame], LogFrame], bool]
) -> Iterator[Sequence[LogFrame]]:
    """Yield the frames in runs; a frame begins a new run if `begins` of the last run and the frame is true."""
    run: list[LogFrame] = []
    for frame in frames:
        if run and (len(run) == MOST_FRAMES or begins(run, frame)):
            yield run
            run = []
        run.append(frame)
    if run:
        yield run


def _is_sent(frame: LogFrame) -> bool:
    return frame.sent and frame.frame.arbitration_id != NOTE_ID


def _recorded_cycle(classifier: FrameClassifier, frames: Sequence[LogFrame]) -> RecordedCycle:
    notes = tuple(frame for frame in frames if frame.frame.arbitration_id == NOTE_ID)
    others = [frame for frame in frames if frame.frame.arbitration_id != NOTE_ID]
    return RecordedCycle(
        frames[0].time_ns,
        tuple(frame for frame in others if not frame.sent and classifier.is_input(frame)),
        tuple(frame for frame in others if frame.sent),
        notes,
    )


def _lockstep_cycles(
    classifier: FrameClassifier, frames: Iterable[LogFrame], period_ns: int
) -> Iterator[RecordedCycle]:
    def begins(run: list[LogFrame], frame: LogFrame) -> bool:
        return snapped(frame, period_ns) != snapped(run[0], period_ns)

    for together in _runs(frames, begins):
        commands = [frame for frame in together if classifier.is_command(frame)]
        own = {frame.number for frame in commands[-1:]}
        own |= {frame.number for frame in together if classifier.is_output(frame) and not classifier.is_command(frame)}
        inbox = tuple(frame for frame in together if frame.number not in own)
        # the daemon's clock in lockstep: the first reading makes the first period pass
        time_ns = snapped(together[0], period_ns) + period_ns
        yield RecordedCycle(time_ns, inbox, tuple(frame for frame in together if frame.number in own))
