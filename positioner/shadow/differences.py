"""How the commands of a law in the shadow differ from those of the acting law, in one dwell or in all. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from positioner.values import dataclass

if TYPE_CHECKING:
    from positioner.cycle.events import Controlled

APART_MA = 0.1
"""A difference that matters. Of the 16 mA that stroke a valve it is 0.6 %: so far it moves a stem that slides, and a
dwell that ends 1 % of span off counts as lost (docs/robustness.md). A command frame resolves 0.001 mA, which two laws
that do the same do not keep: rounding would count as a difference."""
_S_PER_NS = 1e-9


@dataclass(slots=True)
class Differences:
    """What has been compared since the instant begun_ns: cycles in which both laws answered.

    ended_ns: the newest cycle. setpoint_m: the newest setpoint, in m. sum_ma: of the differences' amounts.
    largest_ma: the difference with the largest amount, shadow less acting; measured_m: where the stem was then.
    apart: cycles that differ by more than `APART_MA`. moves, shadow_moves: how often each law has begun one.
    own_move_ns: when the shadow first began one in a cycle in which the acting law began none; None where it never has.
    fallbacks: how often the shadow could not do what it wanted, and why it could not the last time.
    """

    begun_ns: int
    ended_ns: int = 0
    setpoint_m: float = 0.0
    cycles: int = 0
    sum_ma: float = 0.0
    largest_ma: float = 0.0
    measured_m: float = 0.0
    apart: int = 0
    moves: int = 0
    shadow_moves: int = 0
    own_move_ns: int | None = None
    fallbacks: int = 0
    why: str = ""

    def add(self, now_ns: int, acting: Controlled, shadow: Controlled) -> None:
        """Add one cycle."""
        self.ended_ns, self.setpoint_m = now_ns, acting.setpoint_m
        difference_ma = shadow.current_ma - acting.current_ma
        self.cycles += 1
        self.sum_ma += abs(difference_ma)
        self.apart += abs(difference_ma) > APART_MA
        if abs(difference_ma) > abs(self.largest_ma):
            self.largest_ma, self.measured_m = difference_ma, acting.measured_m
        self.moves += acting.decision.reason is not None
        if shadow.decision.reason is not None:
            self.shadow_moves += 1
            if acting.decision.reason is None and self.own_move_ns is None:
                self.own_move_ns = now_ns
        if shadow.decision.fallback:
            self.fallbacks, self.why = self.fallbacks + 1, shadow.decision.fallback

    @property
    def mean_ma(self) -> float:
        """The mean amount of the difference in mA."""
        return self.sum_ma / self.cycles if self.cycles else 0.0

    @property
    def apart_share(self) -> float:
        """The share of the cycles that differ by more than `APART_MA`."""
        return self.apart / self.cycles if self.cycles else 0.0

    @property
    def own_move_s(self) -> float | None:
        """The time in s after the beginning at which the shadow first began a move of its own, None if it never has."""
        return None if self.own_move_ns is None else (self.own_move_ns - self.begun_ns) * _S_PER_NS

    def in_words(self) -> str:
        """Return one line for the log."""
        begun = f"began {self.shadow_moves} moves where the acting law began {self.moves}"
        first_s = self.own_move_s
        own = "" if first_s is None else f", the first of its own after {first_s:.3f} s"
        fallbacks = f", {self.fallbacks} fallbacks (the last: {self.why})" if self.fallbacks else ""
        text = f"{self.cycles} commands, {begun}{own}{fallbacks}"
        if not self.largest_ma:
            return f"{text}; no current differs"
        share = f"{100.0 * self.apart_share:.1f} % of them by more than {APART_MA} mA"
        most = f"most {self.largest_ma:+.3f} mA, with the stem at {1e3 * self.measured_m:.3f} mm"
        return f"{text}; current {self.mean_ma:.3f} mA off in the mean, {share}, {most}"

    def as_dict(self, zero_ns: int) -> dict[str, Any]:
        """Return it for a program, with instants in s since `zero_ns`."""
        return {
            "begin_s": (self.begun_ns - zero_ns) * _S_PER_NS,
            "end_s": (self.ended_ns - zero_ns) * _S_PER_NS,
            "setpoint_m": self.setpoint_m,
            "cycles": self.cycles,
            "mean_difference_ma": self.mean_ma,
            "largest_difference_ma": self.largest_ma,
            "largest_at_m": self.measured_m,
            "share_apart": self.apart_share,
            "apart_ma": APART_MA,
            "moves": self.moves,
            "shadow_moves": self.shadow_moves,
            "own_move_s": None if self.own_move_ns is None else (self.own_move_ns - zero_ns) * _S_PER_NS,
            "fallbacks": self.fallbacks,
        }
