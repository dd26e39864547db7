"""The commands of another law or of other settings, compared with the recorded ones. Pure."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from positioner.cycle.events import Controlled, LawFellBack, ModeChanged
from positioner.replay.recorded import command_in
from positioner.wire.messages import Cause

if TYPE_CHECKING:
    from positioner.replay.run import ReplayedCycle
    from positioner.wire.codec import Codec
    from positioner.wire.messages import CurrentCommand, Mode

_LEAST_DIFFERENCE_MA = 0.0005
"""Half a bit of the command frame."""
_REASONS_SHOWN = 5
_REASONS_KEPT = 1000
"""Some reasons contain a number: if there are more different ones, the others are counted together."""

_Gap = tuple[float, float, float, float]
"""Difference in mA, time in s, and recorded and computed current in mA."""


@dataclass(frozen=True, slots=True)
class Row:
    """One cycle in which a command was recorded or computed; None where there is none."""

    time_s: float
    setpoint_m: float | None
    measured_m: float | None
    recorded_ma: float | None
    computed_ma: float | None
    recorded_mode: Mode | None
    computed_mode: Mode
    fallback: str
    reason: str
    cause: Cause = Cause.NONE
    """Of the computed mode."""


@dataclass(slots=True)
class OtherLaw:
    """Summary of the cycles given to `add`."""

    codec: Codec
    both: int = 0
    recorded_only: int = 0
    computed_only: int = 0
    fallbacks: Counter[str] = field(default_factory=Counter)
    modes: Counter[Mode] = field(default_factory=Counter)
    _sum_ma: float = 0.0
    _first: _Gap | None = None
    _largest: _Gap | None = None
    _last_ns: int | None = None
    _cause: Cause = Cause.NONE

    def add(self, replayed: ReplayedCycle) -> Row | None:
        """Count one cycle; return its row if a command was recorded or computed in it."""
        if self._last_ns is not None:
            self.modes[replayed.mode] += replayed.recorded.time_ns - self._last_ns
        self._last_ns = replayed.recorded.time_ns
        for event in replayed.events:
            if isinstance(event, LawFellBack):
                self.fallbacks[event.why if self._is_kept(event.why) else "for other reasons"] += 1
            elif isinstance(event, ModeChanged):
                self._cause = event.cause
        recorded, _ = command_in(self.codec, (logged.frame for logged in replayed.recorded.outbox)) or (None, None)
        computed, _ = command_in(self.codec, replayed.computed) or (None, None)
        if recorded is None and computed is None:
            return None
        time_s = _stamp_ns(replayed) * 1e-9
        self._compare(time_s, recorded, computed)
        controlled = next((event for event in replayed.events if isinstance(event, Controlled)), None)
        return Row(
            time_s,
            controlled.setpoint_m if controlled else None,
            controlled.measured_m if controlled else None,
            recorded.current_ma if recorded else None,
            computed.current_ma if computed else None,
            recorded.mode if recorded else None,
            replayed.mode,
            controlled.decision.fallback if controlled else "",
            str(controlled.decision.reason or "") if controlled else "",
            self._cause,
        )

    def in_words(self) -> str:
        """Return the summary."""
        alone = f"{self.recorded_only} recorded only, {self.computed_only} computed only"
        lines = [f"commands: {self.both} in both, {alone}"]
        if self._first and self._largest:
            lines += [
                f"difference of current: mean {self._sum_ma / self.both:.3f} mA, largest {_at(self._largest)}",
                f"first difference: {_at(self._first)}",
            ]
        elif self.both:
            lines.append("no difference: every current is as recorded")
        modes = ", ".join(f"{mode.name} {spent_ns * 1e-9:.3f} s" for mode, spent_ns in sorted(self.modes.items()))
        lines.append(f"modes: {modes}")
        lines.append(f"fallbacks: {self.fallbacks.total()}")
        lines += [f"  {times} × {why}" for why, times in self.fallbacks.most_common(_REASONS_SHOWN)]
        return "\n".join(lines)

    def as_json(self) -> dict[str, Any]:
        """Return the summary for a program."""
        return {
            "commands_in_both": self.both,
            "commands_recorded_only": self.recorded_only,
            "commands_computed_only": self.computed_only,
            "mean_difference_ma": self._sum_ma / self.both if self.both else None,
            "largest_difference": _gap_as_json(self._largest),
            "first_difference": _gap_as_json(self._first),
            "time_in_mode_s": {mode.name: spent_ns * 1e-9 for mode, spent_ns in sorted(self.modes.items())},
            "fallbacks": dict(self.fallbacks.most_common()),
        }

    def _is_kept(self, why: str) -> bool:
        return why in self.fallbacks or len(self.fallbacks) < _REASONS_KEPT

    def _compare(self, time_s: float, recorded: CurrentCommand | None, computed: CurrentCommand | None) -> None:
        if recorded is None or computed is None:
            self.recorded_only += recorded is not None
            self.computed_only += computed is not None
            return
        gap_ma = abs(computed.current_ma - recorded.current_ma)
        gap = (gap_ma, time_s, recorded.current_ma, computed.current_ma)
        self.both += 1
        self._sum_ma += gap_ma
        self._largest = max(self._largest or gap, gap)
        if self._first is None and gap_ma > _LEAST_DIFFERENCE_MA:
            self._first = gap


def _stamp_ns(replayed: ReplayedCycle) -> int:
    """Return the time of a cycle's frames in the log."""
    cycle = replayed.recorded
    return next((logged.time_ns for logged in (*cycle.outbox, *cycle.inbox)), cycle.time_ns)


def _gap_as_json(gap: _Gap | None) -> dict[str, float] | None:
    names = ("difference_ma", "time_s", "recorded_ma", "computed_ma")
    return None if gap is None else dict(zip(names, gap, strict=True))


def _at(gap: _Gap) -> str:
    gap_ma, time_s, recorded_ma, computed_ma = gap
    return f"{gap_ma:.3f} mA at {time_s:.3f} s ({recorded_ma:.3f} mA recorded, {computed_ma:.3f} mA computed)"
