"""The positioner's modes over a run, from its frames: when each began and ended, and its cause. Pure.

Every command carries the mode; the status carries also the cause, ten times a second. A mode that ends before the next
status has an unknown cause. When no command comes for so long that an actuator goes to its fail position, the
positioner counts as silent.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.values import dataclass, replace
from positioner.wire.messages import Cause, Mode
from positioner.wire.words import in_words

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

ACTIVE_AT_LEAST = 0.99
"""Part of a run in which the mode must be ACTIVE; else the figures are not the law's."""

_MOST_SHOWN = 12
_COMMANDING = frozenset({Mode.ACTIVE, Mode.HOLD, Mode.FAILSAFE})
_SLOW = "this machine was too slow for this period: free a processor, or choose a longer sample_period_s"
_NO_SETPOINT = (
    "no setpoint came for guard.setpoint_hold_s: let it be longer than setpoint_period_s; where it is, this machine "
    "was too slow: free a processor"
)
_NEVER_ARMED = "nothing armed it: do not set guard.auto_arm to false"
_ADVICE = {
    Cause.FEEDBACK_STALE: _SLOW,
    Cause.SETPOINT_STALE: _NO_SETPOINT,
    Cause.LAW_FAILED: "the law gave no answer",
    Cause.FEEDBACK_IMPLAUSIBLE: "[guard] and the travel of [valve] define which readings are plausible",
    Cause.FEEDBACK_FROZEN: "[guard] frozen_s and frozen_command_ma define when a sensor counts as frozen",
    Cause.FOREIGN_COMMAND: "another controller is on this bus: give --bus another one",
    Cause.WAITING_FOR_ARM: _NEVER_ARMED,
}


@dataclass(frozen=True, slots=True)
class ModeReport:
    """The mode in one frame of the positioner; `cause` is None in a command, which carries none."""

    time_s: float
    mode: Mode
    cause: Cause | None = None


@dataclass(frozen=True, slots=True)
class ModeSpan:
    """A span of time in one mode: `mode` is None for silence, `cause` None where it is unknown."""

    mode: Mode | None
    cause: Cause | None
    begin_s: float
    end_s: float

    @property
    def duration_s(self) -> float:
        """Length in s."""
        return self.end_s - self.begin_s

    @property
    def is_normal(self) -> bool:
        """Whether it is ACTIVE without a cause that limits it."""
        return self.mode is Mode.ACTIVE and self.cause in {Cause.NONE, None}

    def __str__(self) -> str:
        """Mode and cause in words: `FAILSAFE (feedback stale)`."""
        return f"{name_of(self.mode)} ({cause_in_words(self.cause)})" if self.cause else name_of(self.mode)


def name_of(mode: Mode | None) -> str:
    """Return the name of a mode, `SILENT` for none."""
    return "SILENT" if mode is None else mode.name


def cause_in_words(cause: Cause | None) -> str:
    """Return a cause in words."""
    return "cause unknown" if cause is None else in_words(cause)


@dataclass(slots=True)
class _Edge:
    """Where a span begins; its cause may become known later."""

    begin_s: float
    mode: Mode | None
    cause: Cause | None


def mode_spans(mode_reports: Iterable[ModeReport], duration_s: float, silent_after_s: float) -> tuple[ModeSpan, ...]:
    """Return the spans from 0 to `duration_s`; together they cover the run without gaps.

    Args:
        mode_reports: the modes in the frames, in order of arrival.
        duration_s: length of the run.
        silent_after_s: how long after the last command the positioner counts as silent.
    """
    edges = [_Edge(0.0, Mode.INIT, None)]
    command_s = 0.0
    for each in sorted(mode_reports, key=lambda each: each.time_s):
        if each.time_s >= duration_s:
            break
        if each.cause is None:
            _fall_silent(edges, command_s + silent_after_s, each.time_s)
            command_s = each.time_s
        here = edges[-1]
        if each.mode is not here.mode or (here.cause is not None and each.cause not in {here.cause, None}):
            edges.append(_Edge(max(each.time_s, 0.0), each.mode, each.cause))
        elif here.cause is None:
            here.cause = each.cause
    _fall_silent(edges, command_s + silent_after_s, duration_s)
    ends_s = [*(edge.begin_s for edge in edges[1:]), duration_s]
    spans = (ModeSpan(edge.mode, edge.cause, edge.begin_s, end_s) for edge, end_s in zip(edges, ends_s, strict=True))
    return tuple(_merged(span for span in spans if span.duration_s > 0.0))


def _fall_silent(edges: list[_Edge], silent_s: float, now_s: float) -> None:
    """Begin a silence at `silent_s` if a command was due and none came before `now_s`."""
    if edges[-1].mode in _COMMANDING and silent_s < now_s:
        edges.append(_Edge(max(silent_s, edges[-1].begin_s), None, None))


def _merged(spans: Iterable[ModeSpan]) -> Iterator[ModeSpan]:
    """Yield `spans`, adjacent ones of the same mode and cause as one; ACTIVE of unknown cause is normal."""
    last: ModeSpan | None = None
    for each in spans:
        span = replace(each, cause=Cause.NONE) if each.is_normal else each
        if last and (last.mode, last.cause) == (span.mode, span.cause):
            last = replace(last, end_s=span.end_s)
            continue
        if last:
            yield last
        last = span
    if last:
        yield last


def active_fraction(spans: Sequence[ModeSpan]) -> float:
    """Return the part of the run, 0 to 1, in which the mode was ACTIVE."""
    return sum(span.duration_s for span in spans if span.mode is Mode.ACTIVE) / sum(span.duration_s for span in spans)


def mode_lines(spans: Sequence[ModeSpan]) -> tuple[str, ...]:
    """Return the modes for a terminal: how long ACTIVE, and a line for each span that is not normal."""
    others = [span for span in spans if not span.is_normal]
    lines = [f"ACTIVE {_percent(active_fraction(spans))} of the time"]
    lines += [
        f"{span.begin_s:9.3f} to {span.end_s:.3f} s  {name_of(span.mode)}: {cause_in_words(span.cause)}"
        for span in others[:_MOST_SHOWN]
    ]
    if len(others) > _MOST_SHOWN:
        lines.append(f"and {len(others) - _MOST_SHOWN} more: see result.json")
    return tuple(lines)


def complaint(spans: Sequence[ModeSpan], log: str) -> str | None:
    """Return in one line why the figures of a run are not the law's, or None; `log` is the file with details."""
    active = active_fraction(spans)
    if active >= ACTIVE_AT_LEAST:
        return None
    spent_s: dict[tuple[Mode | None, Cause | None], float] = {}
    others = [span for span in spans if span.mode is not Mode.ACTIVE]
    for span in others:
        spent_s[span.mode, span.cause] = spent_s.get((span.mode, span.cause), 0.0) + span.duration_s
    worst = max(spent_s, key=lambda each: spent_s[each])
    first = next(span for span in others if (span.mode, span.cause) == worst)
    mode, cause = worst
    advice = _ADVICE.get(cause) if cause is not None else _SLOW if mode is None else None
    where_to_look = f"{advice}; see {log}" if advice else f"see {log}"
    return (
        f"ACTIVE for {_percent(active)} of the run: below {_percent(ACTIVE_AT_LEAST)} its figures are not the law's; "
        f"{first} for {spent_s[worst]:.3f} s, first at {first.begin_s:.3f} s; {where_to_look}"
    )


def _percent(part: float) -> str:
    """Return a part, 0 to 1, in percent; only a part of 1 gives `100 %`."""
    return "100 %" if part >= 1.0 else f"{min(100.0 * part, 99.99):.4g} %"
