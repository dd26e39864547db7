"""Explained commands and moves in words and numbers. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.diagnostics.explanation import ActiveBound
from positioner.wire.messages import Cause, Motion
from positioner.wire.words import in_words

if TYPE_CHECKING:
    from collections import Counter

    from positioner.diagnostics.explanation import ExplainedCommand, ExplainedMove
    from positioner.laws.move_reason import Believed

_MM = 1e3
_MOTIONS = {
    Motion.NONE: "controls",
    Motion.REST: "holds the stem at rest, in the middle of its stick band, and averages readings",
    Motion.MOVE: "moves the stem",
    Motion.SETTLE: "waits until the stem has certainly stopped",
}


MOVES_HEAD = (
    *("move", "at, s", "lasts, ms", "from, mm", "setpoint, mm", "aim, mm", "landed, mm", "off, mm", "current, mA"),
    *("Γ, mA", "fallback"),
)


def move_row(move: ExplainedMove) -> tuple[str, ...]:
    """Return the cells of a move, as `MOVES_HEAD` names them."""
    lasts = "" if move.ended_s is None else f"{(move.ended_s - move.begun_s) * _MM:.1f}"
    landed, off = ("", "") if move.landed_m is None else (_mm(move.landed_m), f"{_off_mm(move):+.3f}")
    places = (_mm(move.origin_m), _mm(move.setpoint_m), _mm(move.reason.aim_m), landed, off)
    currents = f"{move.low_ma:.3f}–{move.high_ma:.3f}", f"{move.reason.breakaway_ma:.3f}"
    fallback = move.fallbacks[0] if move.fallbacks else ""
    return str(move.number), f"{move.begun_s:.3f}", lasts, *places, *currents, fallback


def command_lines(command: ExplainedCommand) -> list[str]:
    """Return the explanation of one command."""
    cause = f" ({in_words(command.cause)})" if command.cause is not Cause.NONE else ""
    mode = f"{command.mode.name}{cause}"
    lines = [f"command   {command.current_ma:.3f} mA at {command.time_s:.6f} s", f"mode      {mode}"]
    controlled, move = command.controlled, command.move
    if controlled is None or command.bound is None:
        return [*lines, "law       not asked: the guard decided"]
    stem, decision = controlled.stem, controlled.decision
    stuck = "at rest" if stem.stuck else f"sliding at {stem.velocity_m_per_s * _MM:+.2f} mm/s"
    lines += [
        f"law       {_MOTIONS[decision.motion]}",
        f"stem      {_mm(stem.position_m)} mm, {stuck}; reading {_mm(controlled.measured_m)} mm",
        f"setpoint  {_mm(controlled.setpoint_m)} mm",
        f"bound     {_bound_words(command)}",
    ]
    if command.fallback:
        lines.append(f"fallback  {command.fallback}")
    if decision.differs:
        lines.append("valve     does not move as configured: identify it again")
    if move is not None:
        lines += _move_lines(move)
    return lines


def counts_line(counts: Counter[str]) -> str:
    """Return how many commands met which bound."""
    total = sum(counts.values())
    parts = [f"{number} {name}" for name, number in counts.most_common()]
    return f"{total} commands: {', '.join(parts)}" if parts else "no commands"


def _move_lines(move: ExplainedMove) -> list[str]:
    lines = [
        f"move      number {move.number}, begun at {move.begun_s:.6f} s at {_mm(move.origin_m)} mm",
        f"error     {move.reason.error_m * _MM:+.3f} mm, which it is to correct",
        f"Γ         {move.reason.breakaway_ma:.3f} mA",
        f"aim       {_mm(move.reason.aim_m)} mm",
    ]
    if move.reason.believed is not None:
        lines.append(f"believed  {_believed(move.reason.believed)}")
    if move.landed_m is None or move.ended_s is None:
        return [*lines, "landing   the log ends before it"]
    text = f"landing   {_mm(move.landed_m)} mm, {_off_mm(move):+.3f} mm from the aim, after "
    return [*lines, f"{text}{(move.ended_s - move.begun_s) * _MM:.1f} ms; {move.low_ma:.3f} to {move.high_ma:.3f} mA"]


def _believed(valve: Believed) -> str:
    """Return what the law believed of the valve, each number with σ."""
    spring, spread = (number / _MM for number in valve.spring_n_per_m)
    forces = ("F_0", valve.offset_n), ("F_s", valve.static_n), ("F_c", valve.coulomb_n)
    told = ", ".join(f"{name} {round(force)} ± {sigma:.0f} N" for name, (force, sigma) in forces)
    return f"K {spring:.2f} ± {spread:.2f} N/mm, {told}; the move ends within ± {valve.ends_m * _MM:.2f} mm (σ)"


def _bound_words(command: ExplainedCommand) -> str:
    controlled = command.controlled
    assert controlled is not None  # noqa: S101 - the caller has looked
    decision, bounds = controlled.decision, controlled.decision.bounds
    currents = f"{bounds.current_low_ma:.3f} to {bounds.current_high_ma:.3f} mA"
    speeds = f"{bounds.speed_low_m_per_s * _MM:.1f} to {bounds.speed_high_m_per_s * _MM:.1f} mm/s"
    match command.bound:
        case ActiveBound.GUARD:
            return f"{command.bound}: the law wanted {decision.current_ma:.3f} mA"
        case ActiveBound.REST:
            return "none acts"
        case ActiveBound.BREAKAWAY | ActiveBound.CURRENT:
            return f"{command.bound}, {currents}"
        case ActiveBound.SPEED:
            return f"{command.bound}, {speeds}"
        case _:
            return f"{command.bound}: the plan lies inside {currents} and {speeds}"


def _off_mm(move: ExplainedMove) -> float:
    assert move.landed_m is not None  # noqa: S101 - the caller has looked
    return (move.landed_m - move.reason.aim_m) * _MM


def _mm(position_m: float) -> str:
    return f"{position_m * _MM:.3f}"
