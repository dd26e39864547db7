"""The result of a stroke test: what was measured, the limits that it breaks, the verdict. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import TYPE_CHECKING

from positioner.commissioning.stroke.measured import Record, breakaway_n, jumped_m, lag_s
from positioner.commissioning.stroke.memory import Cause, Phase

if TYPE_CHECKING:
    from positioner.commissioning.stroke.memory import Stop, StrokeMemory
    from positioner.commissioning.stroke.plan import Plan
    from positioner.commissioning.stroke.settings import StrokeSettings
    from positioner.valve.parameters import ValveParameters

_MM = 1e3
_SAYS_NOTHING = frozenset({Cause.STOPPED, Cause.NEW_SETPOINT, Cause.NOT_POSSIBLE})
"""What ends a test without a word about the valve."""
_RESTED = frozenset({Cause.STUCK, Cause.NO_MOTION})
STICKS, NO_AIR = "the stem sticks", "the air is slow or missing"


class Verdict(StrEnum):
    """What a test says of the valve; an aborted one says nothing."""

    PASSED = "passed"
    FAILED = "failed"
    ABORTED = "aborted"


class Limit(StrEnum):
    """A limit that a stroke can break without being ended."""

    HIGH = "breakaway too high"
    LOW = "breakaway too low"
    SLOW = "air too slow"
    NOT_BACK = "not back at its start"


@dataclass(frozen=True, slots=True)
class Finding:
    """A broken limit, and the sentence that tells it."""

    limit: Limit
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class StrokeResult:
    """The result, in SI units; NaN where the test did not come so far.

    stop: why it was ended before its time, None where it was not; ended_by: the words of the guard where that ended it.
    reference_n: the configured F_s. stroke_m: the wanted stroke.
    start_m, reached_m, furthest_m, back_m: where the stem began, rested at the end of the stroke, was at most, and
    ended. out_n, back_n: the forces at the breakaways.
    jump_m, jumped_m: the natural jump that was predicted, and the one that was seen.
    lag_s, expected_lag_s: how late the sliding stem follows the current, and how late it should.
    out_s, home_s: from the begin of each ramp until the stem was at its end. sigma_m: the noise of a reading.
    suspects: what may be the matter where the stem did not move under the force; two where no pressure is measured,
    since a stem that sticks and air that does not come then look alike.
    found_m, elsewhere: where the stem stood before it was moved to the start, and why; NaN and empty where it was not.
    left_m: where it was left then.
    trace: time in s, mean reading in m and current in mA, at most some hundred points for a picture.
    """

    stop: Stop | None
    ended_by: str
    reference_n: float
    lasted_s: float
    start_m: float
    stroke_m: float
    verdict: Verdict = Verdict.ABORTED
    findings: tuple[Finding, ...] = ()
    reached_m: float = math.nan
    furthest_m: float = math.nan
    back_m: float = math.nan
    out_n: float = math.nan
    back_n: float = math.nan
    jump_m: float = math.nan
    jumped_m: float = math.nan
    lag_s: float = math.nan
    expected_lag_s: float = math.nan
    out_s: float = math.nan
    home_s: float = math.nan
    sigma_m: float = math.nan
    found_m: float = math.nan
    left_m: float = math.nan
    elsewhere: str = ""
    suspects: tuple[str, ...] = ()
    trace: tuple[tuple[float, float, float], ...] = ()

    @property
    def cause(self) -> str:
        """The first cause of a verdict other than passed, in few words; empty for that."""
        if self.ended_by:
            return self.ended_by
        if self.stop:
            return str(self.stop.cause)
        return str(self.findings[0].limit) if self.findings else ""

    @property
    def static_n(self) -> float:
        """F_s in N: the mean of both breakaways, which the spring does not change; one where there is only one."""
        if math.isnan(self.back_n):
            return self.out_n
        return 0.5 * (self.out_n + self.back_n)

    @property
    def friction_ratio(self) -> float:
        """F_s over the configured one."""
        return self.static_n / self.reference_n


def stroke_result(
    memory: StrokeMemory, ended_by: str, valve: ValveParameters, settings: StrokeSettings, period_s: float
) -> StrokeResult:
    """Return what the memory of a test at its end shows; ended_by: why the guard ended it, empty where it did not."""
    plan, record = memory.plan, Record.of(memory, period_s)
    result = StrokeResult(
        stop=memory.stop,
        ended_by=ended_by,
        reference_n=valve.static_friction_n,
        lasted_s=record.lasted_s,
        start_m=plan.start_m if plan else memory.first_m,
        stroke_m=settings.stroke_of_span * valve.span_m,
        trace=record.trace(),
        found_m=memory.found_m,
        left_m=math.nan if math.isnan(memory.found_m) else memory.smooth_m,
        elsewhere=memory.elsewhere,
    )
    if plan is None or Phase.APPROACH in record.phases:  # the stroke had not begun
        return result
    out, home = (next((m for m in memory.moved if m.phase is phase), None) for phase in (Phase.OUT, Phase.BACK))
    late_s = lag_s(record, plan, out)
    is_slow = late_s > plan.lag_s + plan.slow_s
    slow_s = late_s if is_slow else math.nan
    result = replace(
        result,
        reached_m=record.rested_m(Phase.PAUSE),
        furthest_m=record.furthest_m(plan),
        back_m=memory.smooth_m if math.isnan(memory.back_m) else memory.back_m,
        out_n=breakaway_n(record, valve, plan, out, slow_s) if out else math.nan,
        back_n=breakaway_n(record, valve, plan, home, slow_s) if home else math.nan,
        jump_m=plan.jump_m,
        jumped_m=jumped_m(record, plan, out) if out else math.nan,
        lag_s=late_s,
        expected_lag_s=plan.lag_s,
        out_s=record.phase_s(Phase.OUT),
        home_s=record.phase_s(Phase.BACK),
        sigma_m=plan.sigma_m,
    )
    if ended_by or (memory.stop and memory.stop.cause in _SAYS_NOTHING):
        return result
    if memory.stop and memory.stop.cause in _RESTED:
        result = replace(result, suspects=_suspects(record, valve, plan, memory.stop))
    findings = _findings(result, settings, plan, is_slow=is_slow)
    verdict = Verdict.FAILED if memory.stop or findings else Verdict.PASSED
    return replace(result, findings=findings, verdict=verdict)


def _suspects(record: Record, valve: ValveParameters, plan: Plan, stop: Stop) -> tuple[str, ...]:
    """Return what may keep a stem at rest; a measured pressure tells whether the air came."""
    pressures_pa = record.whole.pressure_pa
    if not pressures_pa:
        return STICKS, NO_AIR
    at = min(max(round(stop.time_s / record.period_s) - 1, 0), len(pressures_pa) - 1)
    pushed_ma = abs(pressures_pa[at] / valve.pressure_gain_pa_per_ma - plan.balance_ma(stop.position_m))
    return (STICKS,) if pushed_ma > plan.static_ma else (NO_AIR,)


def _findings(result: StrokeResult, settings: StrokeSettings, plan: Plan, *, is_slow: bool) -> tuple[Finding, ...]:
    """Return the limits that the measured values break."""
    ratio, found = result.friction_ratio, []
    friction = f"the static friction is {result.static_n:.0f} N, {ratio:.2f} times the configured one; the limit is "
    if ratio > settings.breakaway_high and not is_slow:
        found.append(Finding(Limit.HIGH, f"{friction}{settings.breakaway_high:g}"))
    if ratio < settings.breakaway_low:
        found.append(Finding(Limit.LOW, f"{friction}{settings.breakaway_low:g}: packing loose, or the stem off"))
    if is_slow:
        most_s = plan.lag_s + plan.slow_s
        text = f"the stem follows the current with a lag of {result.lag_s:.2f} s, the limit is {most_s:.2f} s"
        found.append(Finding(Limit.SLOW, f"{text}: look at the air supply and the I/P converter"))
    off_m = abs(result.back_m - result.start_m)
    if result.stop is None and off_m > plan.tolerance_m:
        found.append(Finding(Limit.NOT_BACK, f"the stem came to rest {off_m * _MM:.1f} mm from its start"))
    return tuple(found)
