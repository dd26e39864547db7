"""The published results of the paper's five simulations, and whether our simulations show the same. Pure.

The paper shows figures and gives no numbers. Each published result here is a sentence of the paper; the threshold that
decides whether it holds is ours.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from positioner.studies.interpretations import Interpretation, Units
from positioner.studies.reproduce import WITH_TABLE

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from positioner.studies.reproduce import PlayedRun

AT_REFERENCE_PCT = 1.0
"""An error below this percentage of the span is "at the reference" or "small"."""

OVERSHOOT_PCT = 0.5
"""An overshoot above this percentage of the span is visible in a figure."""

CONSTANT_CURRENT_MA = 0.8
"""A current that stays within 5 % of the loop's 16 mA is "almost constant"."""

REST_M_PER_S = 0.001
"""A speed is "almost constant" below this one, or after it has fallen to a quarter."""

MOTION_PCT = 0.1
"""The stem moves when its range of motion is above this percentage of the span; below it, the stem rests."""


@dataclass(frozen=True, slots=True)
class Assessment:
    """One published result in one interpretation of the paper: what our run shows, and whether the result holds.

    holds: None where the run is too short to decide. A short run decides only results about moves.
    """

    simulation: int
    result: str
    interpretation: Interpretation
    seen: str
    holds: bool | None


@dataclass(frozen=True, slots=True)
class _PublishedResult:
    """A sentence of the paper, and the check of it.

    check: returns what is seen, in words, and whether the result holds. Its arguments are the run of this simulation
        and the run of simulation `compared_with`.
    by_moves: whether the moves alone decide the result. Then a dwell of milliseconds is enough; other results need the
        stem at rest.
    """

    simulation: int
    text: str
    check: Callable[[PlayedRun, PlayedRun], tuple[str, bool]]
    compared_with: int
    by_moves: bool = False


def assess(played_runs: Sequence[PlayedRun]) -> tuple[Assessment, ...]:
    """Return the assessment of every published result in every interpretation that was played."""
    by_run = {(played.run.simulation, played.run.interpretation): played for played in played_runs}
    found = []
    for published in _PUBLISHED_RESULTS:
        for (simulation, interpretation), own in by_run.items():
            if simulation == published.simulation:
                other = by_run[published.compared_with, _interpretation_of(published.compared_with, interpretation)]
                seen, holds = published.check(own, other)
                decided = holds if published.by_moves or not own.run.short else None
                found.append(Assessment(simulation, published.text, interpretation, seen, decided))
    return tuple(found)


def summary(assessments: Iterable[Assessment]) -> tuple[str, bool | None]:
    """Return how many of `assessments` hold, in words, and whether all do; None where no run decides."""
    decided = [assessment.holds for assessment in assessments if assessment.holds is not None]
    if not decided:
        return "no result decided", None
    return f"{sum(decided)} of {len(decided)} {'result holds' if len(decided) == 1 else 'results hold'}", all(decided)


def _interpretation_of(simulation: int, interpretation: Interpretation) -> Interpretation:
    """Return the interpretation in which `simulation` was played: without a table both units give the same run."""
    return interpretation if simulation in WITH_TABLE else Interpretation(interpretation.noise, Units.SI)


def _reaches(own: PlayedRun, _: PlayedRun) -> tuple[str, bool]:
    errors = (own.before.error_pct, own.after.error_pct)
    return f"error {errors[0]:.2f}, {errors[1]:.2f} %", max(errors) < AT_REFERENCE_PCT


def _overshoots(own: PlayedRun, _: PlayedRun) -> tuple[str, bool]:
    overshoot = max(own.before.overshoot_pct, own.after.overshoot_pct)
    return f"overshoot {overshoot:.2f} %", overshoot > OVERSHOOT_PCT


def _cycles_throughout(own: PlayedRun, _: PlayedRun) -> tuple[str, bool]:
    cycles, dwells = own.before.limit_cycles + own.after.limit_cycles, own.before.dwells + own.after.dwells
    return f"in {cycles} of {dwells} dwells", cycles == dwells


def _worse(own: PlayedRun, other: PlayedRun) -> tuple[str, bool]:
    return f"error {own.after.error_pct:.2f} against {other.after.error_pct:.2f} %", (
        own.after.error_pct > other.after.error_pct
    )


def _starts_alike(own: PlayedRun, other: PlayedRun) -> tuple[str, bool]:
    alike = own.before == other.before
    return "the same to the bit" if alike else "another motion", alike


def _ends_cycle(own: PlayedRun, _: PlayedRun) -> tuple[str, bool]:
    before, after = own.before, own.after
    ranges = f"range {before.range_pct:.2f} → {after.range_pct:.2f} %"
    if not before.limit_cycles:
        return f"there was none, {ranges}", False
    return f"in {after.limit_cycles} of {after.dwells} dwells, {ranges}", not after.limit_cycles


def _calm(own: PlayedRun, _: PlayedRun) -> tuple[str, bool]:
    before, after = own.before.current_range_ma, own.after.current_range_ma
    return f"range {before:.2f} → {after:.2f} mA", after < CONSTANT_CURRENT_MA


def _slow(own: PlayedRun, _: PlayedRun) -> tuple[str, bool]:
    before, after = own.before.speed_m_per_s, own.after.speed_m_per_s
    return f"{before * 1e3:.1f} → {after * 1e3:.1f} mm/s", after < max(before / 4.0, REST_M_PER_S)


def _small_error(own: PlayedRun, other: PlayedRun) -> tuple[str, bool]:
    error = own.after.error_pct
    return f"error {error:.2f} %, without table {other.after.error_pct:.2f}", 0.0 < error < AT_REFERENCE_PCT


def _livelier(own: PlayedRun, other: PlayedRun) -> tuple[str, bool]:
    return _compared(own, other), own.before.range_pct > max(other.before.range_pct, MOTION_PCT)


def _quieter(own: PlayedRun, other: PlayedRun) -> tuple[str, bool]:
    return _compared(own, other), other.before.range_pct > max(own.before.range_pct, MOTION_PCT)


def _compared(own: PlayedRun, other: PlayedRun) -> str:
    return f"range {own.before.range_pct:.2f} against {other.before.range_pct:.2f} %"


_GONE = "the table ends the oscillation"
_CALM = "with the table the current is almost constant"
_SMALL = "the steady error is small, and not zero"
_PUBLISHED_RESULTS = (
    _PublishedResult(1, "the stem reaches the reference", _reaches, 1),
    _PublishedResult(1, "it overshoots in the transient", _overshoots, 1, by_moves=True),
    _PublishedResult(2, "stick-slip makes it oscillate continuously", _cycles_throughout, 2),
    _PublishedResult(2, "the error is worse than without friction", _worse, 1),
    _PublishedResult(3, "it moves as in simulation 2 until the table is used", _starts_alike, 2, by_moves=True),
    _PublishedResult(3, _GONE, _ends_cycle, 2),
    _PublishedResult(3, _CALM, _calm, 2),
    _PublishedResult(3, "with the table the speed is almost constant", _slow, 2),
    _PublishedResult(3, _SMALL, _small_error, 2),
    _PublishedResult(4, "at first it oscillates more than in simulation 3", _livelier, 3),
    _PublishedResult(4, _GONE, _ends_cycle, 2),
    _PublishedResult(4, _SMALL, _small_error, 2),
    _PublishedResult(5, "at first it oscillates less than in simulation 3", _quieter, 3),
    _PublishedResult(5, _GONE, _ends_cycle, 2),
    _PublishedResult(5, _SMALL, _small_error, 2),
)
