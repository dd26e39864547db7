"""How a run in real time kept time, from the instants of its frames: late cycles, delays and periods. Pure.

A cycle is late if its command comes later after the reading than it may: it then acts a period later. The pace is given
twice, of the whole run, and of its *quiet* seconds, in which no other process used the processors. Only the quiet ones
say something about the positioner; without any, nothing is judged.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import Counter
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

from positioner.wire.formats import FrameRejectedError
from positioner.wire.messages import CurrentCommand, Mode, Motion, StemPosition

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from positioner.wire.codec import Codec
    from positioner.wire.messages import CanFrame

QUIET_PROCESSORS = 0.1
"""A second is quiet if others used less than this much of one processor: a kernel at rest uses half of it."""


class Second(NamedTuple):
    """A second of a run, from `begin_s`: how many processors were used by others than the bench.

    stolen_s: processor time that the host of a virtual machine gave to others while this one wanted it (steal).
    """

    begin_s: float
    foreign_processors: float
    stolen_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Answered:
    """A reading at `read_s`, and when its command came: None where none did, then with mode and motion of the next."""

    read_s: float
    came_s: float | None = None
    mode: Mode = Mode.INIT
    motion: Motion = Motion.NONE

    def is_late(self, due_s: float) -> bool:
        """Whether the command came later than `due_s` after the reading, or not at all."""
        return self.came_s is None or self.came_s - self.read_s > due_s


@dataclass(frozen=True, slots=True, kw_only=True)
class Pace:
    """The pace over some seconds: part of the commands that came in time, delays from reading to command, periods."""

    seconds: int
    cycles: int
    in_time: float
    delay_median_s: float
    delay_p99_s: float
    delay_max_s: float
    period_mean_s: float
    period_max_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Timing:
    """How a run kept time.

    due_s: how long after its reading a command may come. late_by_motion, late_by_mode: late cycles, by what the law did
    and by the guard's mode. foreign_processors: how many processors others used, on average. quiet: None if no second
    was. scheduling: policies of emulator and positioner.
    """

    scheduling: str
    due_s: float
    late: int
    late_by_motion: dict[str, int]
    late_by_mode: dict[str, int]
    foreign_processors: float
    whole: Pace | None
    quiet: Pace | None


def timing_of(answered: Sequence[Answered], seconds: Sequence[Second], due_s: float, scheduling: str) -> Timing:
    """Return how a run kept time that consists of `seconds`, one after the other."""
    late = [each for each in answered if each.is_late(due_s)]
    begins_s = [second.begin_s for second in seconds]
    foreign = [second.foreign_processors for second in seconds]
    quiet = [second.foreign_processors < QUIET_PROCESSORS and not second.stolen_s for second in seconds]

    def is_quiet(each: Answered) -> bool:
        index = bisect_right(begins_s, each.read_s) - 1
        return index >= 0 and quiet[index]

    return Timing(
        scheduling=scheduling,
        due_s=due_s,
        late=len(late),
        late_by_motion=dict(Counter(each.motion.name for each in late)),
        late_by_mode=dict(Counter(each.mode.name for each in late)),
        foreign_processors=sum(foreign) / len(foreign) if foreign else 0.0,
        whole=_pace(answered, lambda _each: True, len(seconds), due_s),
        quiet=_pace(answered, is_quiet, sum(quiet), due_s),
    )


def answers(codec: Codec, frames: Iterable[tuple[float, CanFrame]]) -> tuple[Answered, ...]:
    """Return each reading with its answer, from the first one that was answered to the last.

    Each frame has its instant in s. The command names the reading that it answers; those before it were skipped. In a
    user's DBC without such a name it answers the newest one.
    """
    found: list[Answered] = []
    newest: dict[int | None, int] = {}
    done = -1
    for time_s, frame in sorted(frames, key=lambda stamped: stamped[0]):
        try:
            message, counter = codec.decode(frame)
        except FrameRejectedError:
            continue
        if isinstance(message, StemPosition):
            newest[counter or 0] = newest[None] = len(found)
            found.append(Answered(time_s))
        elif isinstance(message, CurrentCommand):
            index = newest.get(message.position_counter, -1)
            if index <= done:  # a command that was repeated
                continue
            for skipped in range(done + 1, index):
                found[skipped] = replace(found[skipped], mode=message.mode, motion=message.motion)
            found[index] = Answered(found[index].read_s, time_s, message.mode, message.motion)
            done = index
    first = next((index for index, each in enumerate(found) if each.came_s is not None), 0)
    return tuple(found[first : done + 1])


def _pace(answered: Sequence[Answered], counts: Callable[[Answered], bool], seconds: int, due_s: float) -> Pace | None:
    """Return the pace of the readings that count, None if none of them was answered."""
    counted = [each for each in answered if counts(each)]
    delays_s = sorted(each.came_s - each.read_s for each in counted if each.came_s is not None)
    came = [each for each in answered if each.came_s is not None]
    periods_s = [
        after.came_s - before.came_s
        for before, after in pairwise(came)
        if counts(before) and counts(after) and before.came_s is not None and after.came_s is not None
    ]
    if not delays_s or not periods_s:
        return None
    return Pace(
        seconds=seconds,
        cycles=len(counted),
        in_time=sum(not each.is_late(due_s) for each in counted) / len(counted),
        delay_median_s=delays_s[len(delays_s) // 2],
        delay_p99_s=delays_s[len(delays_s) * 99 // 100],
        delay_max_s=delays_s[-1],
        period_mean_s=sum(periods_s) / len(periods_s),
        period_max_s=max(periods_s),
    )


def timing_lines(timing: Timing, period_s: float) -> tuple[str, ...]:
    """Return the lines about time for a terminal."""
    late = f" ({_counts(timing.late_by_motion)}; {_counts(timing.late_by_mode)})" if timing.late else ""
    lines = [f"late cycles: {timing.late}{late}"]
    if timing.quiet is None:
        used = f"{timing.foreign_processors:.2f} processors on average"
        lines.append(f"not judged: in each second others used the processors ({used})")
    for name, pace in (("quiet seconds", timing.quiet), ("all seconds", timing.whole)):
        if pace is not None:
            lines += _pace_lines(name, pace, timing.due_s, period_s)
    return tuple(lines)


def _pace_lines(name: str, pace: Pace, due_s: float, period_s: float) -> tuple[str, str]:
    median, most, longest = (1e3 * delay_s for delay_s in (pace.delay_median_s, pace.delay_p99_s, pace.delay_max_s))
    in_time = f"{_percent(pace.in_time)} of {pace.cycles} commands within {due_s * 1e3:g} ms"
    delay = f"delay {median:.2f} ms, 99 % {most:.2f}, longest {longest:.2f}"
    period = f"period {pace.period_mean_s / period_s:.4f}, longest {pace.period_max_s / period_s:.2f} sample periods"
    return f"{name}: {pace.seconds}; {in_time}", f"  {delay}; {period}"


def _counts(counts: dict[str, int]) -> str:
    return ", ".join(f"{count} {name}" for name, count in counts.items())


def _percent(part: float) -> str:
    """Return a part, 0 to 1, in percent; only a part of 1 gives `100 %`."""
    return "100 %" if part >= 1.0 else f"{min(100.0 * part, 99.99):.4g} %"
