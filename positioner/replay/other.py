"""What another law, or other settings, would have done: their commands beside the recorded ones. Pure."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from positioner.events import Controlled, LawFellBack
from positioner.wire.formats import FrameRejectedError
from positioner.wire.messages import CurrentCommand, Mode

if TYPE_CHECKING:
    from collections.abc import Iterable

    from positioner.replay.run import Outcome
    from positioner.wire.codec import Codec
    from positioner.wire.messages import CanFrame

_LEAST_DIFFERENCE_MA = 0.0005
"""Half a bit of the command frame."""
_REASONS_TOLD = 5


@dataclass(frozen=True, slots=True)
class Row:
    """One turn in which a command was recorded or computed; None where there was none."""

    time_s: float
    setpoint_m: float | None
    measured_m: float | None
    recorded_ma: float | None
    computed_ma: float | None
    recorded_mode: Mode | None
    computed_mode: Mode
    fallback: str
    reason: str


@dataclass(slots=True)
class OtherLaw:
    """Collects what `take` is shown."""

    codec: Codec
    rows: list[Row] = field(default_factory=list)
    fallbacks: Counter[str] = field(default_factory=Counter)
    modes: Counter[Mode] = field(default_factory=Counter)
    _last_ns: int | None = None

    def take(self, outcome: Outcome) -> None:
        """Note one turn."""
        if self._last_ns is not None:
            self.modes[outcome.mode] += outcome.turn.time_ns - self._last_ns
        self._last_ns = outcome.turn.time_ns
        self.fallbacks.update(event.why for event in outcome.events if isinstance(event, LawFellBack))
        recorded = self._command([logged.frame for logged in outcome.turn.recorded])
        computed = self._command(outcome.computed)
        if recorded is None and computed is None:
            return
        closed = next((event for event in outcome.events if isinstance(event, Controlled)), None)
        self.rows.append(
            Row(
                _stamp_ns(outcome) * 1e-9,
                closed.setpoint_m if closed else None,
                closed.measured_m if closed else None,
                recorded.current_ma if recorded else None,
                computed.current_ma if computed else None,
                recorded.mode if recorded else None,
                outcome.mode,
                closed.decision.fallback if closed else "",
                closed.decision.reason if closed else "",
            )
        )

    def in_words(self) -> str:
        """Return the summary."""
        both = [
            (row.time_s, row.recorded_ma, row.computed_ma)
            for row in self.rows
            if row.recorded_ma is not None and row.computed_ma is not None
        ]
        lines = [f"commands: {len(both)} in both, {self._only('recorded')}, {self._only('computed')}"]
        apart = [(abs(other - one), time_s, one, other) for time_s, one, other in both]
        first = next((each for each in apart if each[0] > _LEAST_DIFFERENCE_MA), None)
        if first:
            mean_ma = sum(gap for gap, *_ in apart) / len(apart)
            lines += [
                f"difference of current: mean {mean_ma:.3f} mA, largest {_at(max(apart))}",
                f"first difference: {_at(first)}",
            ]
        elif apart:
            lines.append("no difference: every current is as recorded")
        told = ", ".join(f"{mode.name} {spent_ns * 1e-9:.3f} s" for mode, spent_ns in sorted(self.modes.items()))
        lines.append(f"modes: {told}")
        lines.append(f"fallbacks: {self.fallbacks.total()}")
        lines += [f"  {times} × {why}" for why, times in self.fallbacks.most_common(_REASONS_TOLD)]
        return "\n".join(lines)

    def _only(self, side: str) -> str:
        other = "computed" if side == "recorded" else "recorded"
        alone = sum(getattr(row, f"{other}_ma") is None for row in self.rows)
        return f"{alone} {side} only"

    def _command(self, frames: Iterable[CanFrame]) -> CurrentCommand | None:
        for frame in frames:
            try:
                message, _ = self.codec.decode(frame)
            except FrameRejectedError:
                continue
            if isinstance(message, CurrentCommand):
                return message
        return None


def _stamp_ns(outcome: Outcome) -> int:
    """Return the time that the log gives to a turn's frames."""
    turn = outcome.turn
    return next((logged.time_ns for logged in (*turn.recorded, *turn.inbox)), turn.time_ns)


def _at(apart: tuple[float, float, float, float]) -> str:
    gap_ma, time_s, recorded_ma, computed_ma = apart
    return f"{gap_ma:.3f} mA at {time_s:.3f} s ({recorded_ma:.3f} mA recorded, {computed_ma:.3f} mA computed)"
