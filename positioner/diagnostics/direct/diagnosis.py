"""Whether a valve sticks, from its command and its stem position. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from positioner.diagnostics.direct.estimate import Friction, friction_of
from positioner.diagnostics.direct.slips import LEAST_REST, Slip, noise_of, slips_in
from positioner.diagnostics.indirect.loop import block_means, range_of
from positioner.diagnostics.verdict import LEAST_RANGE_PERCENT, LEAST_STICK_PERCENT, Verdict, unexcited

Array = NDArray[np.float64]

LEAST_SLIPS = 6
LEAST_MOVES = 50
_MOVES = 0.01
"""Percent of the command by which it moves at least between two samples."""
_SMALL_NOISE, _SHORT_S, _FEWEST = 0.1, 0.05, 300
"""Percent of span, seconds, and the samples that averaging leaves."""
_STOPS_S = 0.02
"""A stem that creeps to its place within this time shows it; a shorter agreement of readings is no rest."""
_OVER_NOISE, _OVER_RESIDUAL = 4.0, 5.0
_LEAST_JUMP = -0.25
"""Of S: J lies between 0 and S where it is stick and slip."""
_NORMAL_99 = 2.326
_OUTER = 0.01
"""The share of the samples that may lie outside the band of the commands, on either side."""


@dataclass(frozen=True, slots=True)
class Record:
    """Command and stem position in percent of their spans, at equal distances of period_s.

    slope: percent of command for a percent of travel, as far as it is known, and slope_sigma how well.
    most_lag: samples by which the readings may follow the commands.
    """

    command: Array
    position: Array
    period_s: float
    slope: float = 1.0
    slope_sigma: float = 0.15
    most_lag: int = 2


@dataclass(frozen=True, slots=True)
class DirectDiagnosis:
    """S and J in percent of the command's span, None where too few slips show them; band: see `band_of`.

    lag: samples by which the reading follows the command; noise: of a reading, in percent.
    """

    verdict: Verdict
    reason: str
    friction: Friction | None
    slips: tuple[Slip, ...]
    band: float
    noise: float
    lag: int

    @property
    def has_jump(self) -> bool:
        """Whether the stem jumps; otherwise it has a dead band only."""
        return self.friction is not None and self.friction.jump.low > 0.0


def diagnose_stem(record: Record) -> DirectDiagnosis:
    """Return the diagnosis of a record.

    Its lag is the one at which the stem follows closely; else the one at which the slips agree best with each other.
    """
    found = [_with_lag(record, lag) for lag in range(record.most_lag + 1)]
    for each in found:
        if each.verdict is Verdict.NO and each.friction is None:
            return each
    return min(found, key=_disagreement)


def _disagreement(found: DirectDiagnosis) -> float:
    """Return the residual of the slips, larger the fewer of them came at a command that was farther than before."""
    if found.friction is None:
        return math.inf
    farther = sum(slip.half_step > 0.0 for slip in found.slips) / len(found.slips)
    return found.friction.residual / max(farther * farther, 1e-6)


def _with_lag(record: Record, lag: int) -> DirectDiagnosis:
    command, position = record.command[: record.command.size - lag], record.position[lag:]
    factor = _factor(position, record.period_s)
    every, position = command, block_means(position, factor)
    command = block_means(command, factor)
    slope, offset = _line(command, position, record)
    left = position - (command - offset) / slope
    noise = min(noise_of(position), float(np.std(left)))
    least = max(LEAST_REST, round(_STOPS_S / (record.period_s * factor)))
    slips = slips_in(every, position, max(noise, 1e-6), factor, least)
    up = sum(slip.direction > 0.0 for slip in slips)
    band = band_of(command - offset - slope * position, command)
    bare = DirectDiagnosis(Verdict.UNDECIDED, "", None, tuple(slips), band, noise, lag)
    noise_band = 2.0 * _NORMAL_99 * noise * abs(slope)
    quiet = math.sqrt(max(band * band - noise_band * noise_band, 0.0))
    moves, moved = int(np.sum(_moving(command))), range_of(every)
    if quiet < LEAST_STICK_PERCENT and moves >= LEAST_MOVES and moved > LEAST_RANGE_PERCENT:
        verdict, reason = _told_no(noise * abs(slope), f"the stem follows the command within {band:.2f} %")
        return replace(bare, verdict=verdict, reason=reason)
    if len(slips) < LEAST_SLIPS or not 0 < up < len(slips):
        if moved <= LEAST_RANGE_PERCENT:
            return replace(bare, reason=unexcited(moved))
        count = f"{up} slips up and {len(slips) - up} down"
        return replace(bare, reason=f"{count}: {LEAST_SLIPS} are needed, and both directions")
    friction = friction_of(slips, max(noise, 1e-6), record.slope, record.slope_sigma)
    band = band_of(command - friction.offset - friction.slope * position, command)
    verdict, reason = _judged(friction, slips, band, noise)
    if verdict is Verdict.YES and abs(friction.slope - record.slope) > 3.0 * record.slope_sigma:
        reason = f"the slips show a slope of {friction.slope:.2f}, not the known {record.slope:.2f} %/%"
        verdict = Verdict.UNDECIDED
    return replace(bare, verdict=verdict, reason=reason, friction=friction, band=band)


def _line(command: Array, position: Array, record: Record) -> tuple[float, float]:
    """Return slope and offset of the line about which the commands lie: the known slope, if the record agrees."""
    spread = float(np.std(position))
    slope = record.slope
    if spread > 0.0:
        correlation = float(np.corrcoef(command, position)[0, 1]) if np.std(command) > 0.0 else 0.0
        if correlation > 0.98:  # noqa: PLR2004 - the stem follows: the record knows the slope better
            slope = float(np.std(command)) / spread / correlation
    return slope, float(np.median(command - slope * position))


def _factor(position: Array, period_s: float) -> int:
    """Return how many readings to average: as many as make the noise small, within a time that is short for a slip."""
    wanted = math.ceil((noise_of(position) / _SMALL_NOISE) ** 2)
    return max(min(wanted, int(_SHORT_S / period_s), position.size // _FEWEST), 1)


def band_of(off: Array, command: Array) -> float:
    """Return the width of the band in which the commands lie about the line of the spring: 2·F_s/B, and the noise.

    Only samples count in which the command moves: a loop at rest shows nothing.
    """
    moves = _moving(command)
    off = off[moves] if np.sum(moves) >= LEAST_MOVES else off
    return float(np.quantile(off, 1.0 - _OUTER) - np.quantile(off, _OUTER))


def _moving(command: Array) -> NDArray[np.bool_]:
    return np.asarray(np.abs(np.diff(command, prepend=command[0])) > _MOVES)


def _told_no(noise: float, reason: str) -> tuple[Verdict, str]:
    """Return a no, where the noise of the position, in percent of the command, lets the least S be seen."""
    if _OVER_NOISE * noise > LEAST_STICK_PERCENT:
        return Verdict.UNDECIDED, f"the noise of the position, {noise:.2f} %, hides an S of {LEAST_STICK_PERCENT} %"
    return Verdict.NO, reason


def _judged(friction: Friction, slips: list[Slip], band: float, noise: float) -> tuple[Verdict, str]:
    stick, jump = friction.stick, friction.jump
    step = float(np.median([slip.half_step for slip in slips]))
    if stick.high < LEAST_STICK_PERCENT:
        return _told_no(noise * friction.slope, f"S is below {LEAST_STICK_PERCENT} %")
    limits = (
        (LEAST_STICK_PERCENT, f"{LEAST_STICK_PERCENT} %"),
        (_OVER_NOISE * noise * friction.slope, "four times the noise of the position"),
        (_OVER_RESIDUAL * friction.residual, "five times what the slips leave unexplained"),
        (2.0 * step, "the steps of the command, which moves too fast to see a slip"),
    )
    for limit, what in limits:
        if stick.value <= limit:
            return Verdict.UNDECIDED, f"S of {stick.value:.2f} % is not above {what}"
    if not _LEAST_JUMP * stick.value <= jump.value <= 1.25 * stick.value:
        return Verdict.UNDECIDED, f"J of {jump.value:.2f} % does not lie between 0 and S: this is no stick and slip"
    if stick.low > band:
        return Verdict.UNDECIDED, f"the stem follows the command within {band:.2f} %, less than S"
    what = "the stem sticks and jumps" if jump.low > 0.0 else "the valve has a dead band; no jump is seen"
    return Verdict.YES, f"{what}, in {len(slips)} slips"
