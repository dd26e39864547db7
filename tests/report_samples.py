"""Documents as procedures give them, of the paper's valve; `later` is with a quarter more friction."""

from __future__ import annotations

import math
from datetime import UTC, datetime
from typing import Any

from positioner.commissioning.results import KeptResult
from positioner.commissioning.stroke.report import NO_CREDIT
from positioner.config.schema import Configuration
from positioner.health.alarms import Alarm
from positioner.health.causes import AlarmCause
from positioner.health.counters import Counters
from positioner.health.friction_trend import FrictionTrend
from positioner.health.reference import reference_of
from positioner.health.watch import Trends
from positioner.report.trend_sections import Service
from positioner.values import replace
from positioner.valve.parameters import ValveParameters
from positioner.wire.messages import Health

HOSTILE = '<b onclick="x()">&"\''
MOMENT = datetime(2026, 3, 9, 14, 5, tzinfo=UTC)
LATER = datetime(2026, 9, 21, 6, 40, tzinfo=UTC)


def row(name: str, unit: str, value: float, off: float = 0.0) -> dict[str, Any]:
    return {"name": name, "unit": unit, "value": value, "low": value - off, "high": value + off, "seen": True}


def signature(more: float = 1.0) -> dict[str, Any]:
    """Return a signature with `more` times the friction of the paper's valve, as the closed forms give it."""
    gain, spring, sliding, static = 333.637, 52538.0, 1423.0 * more, 1707.7 * more
    low, high = (4.0 * gain + sliding) / spring, (20.0 * gain - sliding) / spring
    steps = [low + (high - low) * number / 40.0 for number in range(41)]
    loop = [
        {
            "direction": side,
            "pressure_ma": [
                *((spring * x + side * sliding) / gain for x in way),
                (spring * end - side * sliding) / gain,
            ],
            "position_m": [*way, end],
        }
        for side, way, end in ((1.0, steps, high), (-1.0, steps[::-1], low))
    ]
    inside = steps[6:35:4]
    return {
        "valve": "FV-101",
        "quantities": {
            "spring_n_per_m": spring,
            "sliding_n": sliding,
            "static_n": static,
            "hysteresis_m": 2.0 * sliding / spring,
        },
        "rows": [
            row("spring rate", "N/m", spring, 40.0),
            row("spring force at 0", "N", -0.25, 3.0),
            row("sliding friction", "N", sliding, 7.0),
            row("sliding friction, least", "N", 0.98 * sliding),
            row("sliding friction, largest", "N", 1.03 * sliding),
            row("static friction", "N", static, 9.0),
            row("hysteresis", "% of span", 100.0 * 2.0 * sliding / spring / 0.127),
            row("dynamic error band", "% of span", 25.9),
            row("bench set, at 0 %", "bar", 0.0) | {"note": "extrapolated"},
            row("bench set, at 100 %", "bar", 1.034) | {"note": "extrapolated"},
            {**row("seat load", "N", 0.0), "value": None, "low": None, "high": None, "seen": False},
        ],
        "sliding_friction_by_place": [
            [x, sliding * (1.0 + 0.03 * (-1) ** number * number / 8)] for number, x in enumerate(inside)
        ],
        "breakaways": [[x, side, static * (1.0 + 0.01 * side)] for x in inside[::2] for side in (1.0, -1.0)],
        "loop": loop,
        "fitted": {
            "spring": {"position_m": [low, high], "pressure_ma": [[spring * low / gain, spring * high / gain]]},
            "friction": {
                "position_m": [low, high],
                "pressure_ma": [[(spring * x + side * sliding) / gain for x in (low, high)] for side in (1.0, -1.0)],
            },
        },
        "remarks": [
            "strokes at 1 mA/s: the stem slid at 6.35 mm/s",
            "from 8 places of the travel, and 8 breakaways",
            "seat load: not measured, the stem did not meet the closed stop",
            f"not reached: {high * 1e3:.1f} to 139.7 mm; bench set and stop there are extrapolated",
            f"not reached: 0.0 to {low * 1e3:.1f} mm; bench set and stop there are extrapolated",
        ],
    }


SIGNATURE = signature()


def _spread(median: float | None) -> dict[str, Any]:
    if median is None:
        return {"median": None, "low": None, "high": None, "count": 0}
    return {"median": median, "low": 0.9 * median, "high": 1.1 * median, "count": 3}


def step_test(slower: float = 1.0) -> dict[str, Any]:
    sizes = []
    for size in (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1):
        for side in ("up", "down"):
            moves = size > 0.002
            figures = {
                "dead_time_s": _spread(0.0028 * slower if moves else None),
                "t63_s": _spread((0.012 + 0.02 * size) * slower if moves else None),
                "t86_s": _spread((0.021 + 0.03 * size) * slower if moves else None),
                "t98_s": _spread((0.038 + 0.04 * size) * slower if moves else None),
                "overshoot": _spread((0.02 if side == "up" else 0.03) if moves else None),
                "gain": _spread(1.0 - 0.0005 / size if moves else None),
            }
            region = "A" if not moves else "B" if size < 0.01 else "C"
            head = {"size": size, "direction": side, "responses": 3, "moved": 3 if moves else 0, "region": region}
            sizes.append({**head, **figures})
    times = [0.002 * number for number in range(-7, 29)]
    responses = [
        {"size": size, "direction": side, "time_s": times,
         "part": [1.0 - math.exp(-max(each - 0.0028, 0.0) / 0.012) for each in times]}
        for size in (0.005, 0.1)
        for side in ("up", "down")
    ]  # fmt: skip
    return {
        "valve": "FV-101",
        "period_s": 0.004,
        "sizes": sizes,
        "responses": responses,
        "rows": [
            row(f"{name}, {side}", "% span", value, 0.05)
            for name, value in (("dead band", 0.31), ("resolution", 0.22))
            for side in ("up", "down")
        ],
        "between": "lies between",
        "remarks": [
            "wait 2 s, 3 repeats, at 60 % of the span, period 4 ms, noise 0.05 % of span",
            "the dead time ends with a motion of 0.1 % of span; a rest that differs by less than 0.025 % is no motion",
            "dead band and resolution: by ladders, each with the uncertainty of a step, 0.1 % of span",
            "an overshoot of less than 0.024 % of span for 0.1 s is not seen",
        ],
    }


def stroke_test(verdict: str = "passed", cause: str = "", why: str = "", friction: float = 1.0) -> dict[str, Any]:
    ways = [min(max(number - 8, 0), max(100 - number, 0), 40) / 40.0 for number in range(101)]
    trace = [[0.25 * number, 0.0762 - 0.0127 * way, 12.0 - 3.2 * way] for number, way in enumerate(ways)]
    rows = {
        "start": ("mm", 76.2),
        "stroke": ("mm", 12.7),
        "furthest": ("mm", 12.74),
        "back at the start within": ("mm", 0.0325),
        "natural jump, predicted": ("mm", 5.419),
        "natural jump, seen": ("mm", 5.435),
        "breakaway, out": ("N", 1712.0 * friction),
        "breakaway, back": ("N", 1704.0 * friction),
        "breakaway, mean": ("N", 1708.0 * friction),
        "of the configured friction": ("%", 100.0 * friction),
        "lag": ("ms", 52.0),
        "lag, expected": ("ms", 50.0),
        "time out": ("s", 10.1),
        "time back": ("s", 10.3),
        "noise of the position": ("mm", 0.0588),
        "duration": ("s", 25.0),
    }
    return {
        "valve": "FV-101",
        "verdict": verdict,
        "cause": cause,
        "stop": {"cause": cause, "why": why} if why else None,
        "findings": [],
        "quantities": {name: value for name, (_, value) in rows.items()},
        "units": {name: unit for name, (unit, _) in rows.items()},
        "trace": trace,
        "remarks": ["a stem with the configured friction jumps by 5.4 mm at its breakaway", NO_CREDIT],
    }


IDENTIFY: dict[str, Any] = {
    "valve": "FV-101",
    "rows": [
        row("spring rate", "N/m", 52538.0, 60.0),
        row("static friction", "N", 1707.7, 6.0),
        row("sliding friction", "N", 1423.0, 4.0),
        row("lag, filling", "ms", 50.2, 0.9),
        row("dead time", "ms", 2.1, 0.8),
        row("noise, part of the span", "%", 0.05, 0.002),
    ],
    "remarks": ["from 12 breakaways and 8 steps"],
}


def counters() -> Counters:
    travel = tuple(int(2000 * max(0.02, 1.0 - ((number - 13) / 4.0) ** 2)) for number in range(22))
    deviation = (12, 30, 90, 140, 410, 900, 2600, 52000, 2500, 820, 400, 150, 80, 25, 9)
    spans = tuple(int(900 / (1 + number) ** 2) for number in range(21))
    hour_us = 3_600_000_000
    return Counters(
        observed=1_700_000_000,
        starts=7,
        mode_us=(40_000_000, 3 * hour_us, 4690 * hour_us, 900_000_000, 20_000_000, hour_us),
        controlled_us=4690 * hour_us,
        stuck_us=4410 * hour_us,
        open_us=3 * hour_us,
        slips=48_212,
        sticks=48_212,
        moves=48_300,
        failed_pushes=88,
        travel_m=612.4,
        reversals=31_009,
        cycles=12_404,
        travel=travel,
        deviation=deviation,
        spans=spans,
    )


def result(kind: str, document: dict[str, Any], name: str = "a", moment: datetime = MOMENT) -> KeptResult:
    return KeptResult(kind, name, "FV-101", moment, {"positioner": "0.1.0 (interpreted)"}, document)


def signatures(more: float) -> tuple[KeptResult, ...]:
    """Return three signatures between the first and the last moment, on the way to `more` times the friction."""
    whole = LATER - MOMENT
    parts = ((0.0, 1.0), (0.45, 1.0 + 0.3 * (more - 1.0)), (1.0, more))
    return tuple(result("signature", signature(each), f"{part}", MOMENT + part * whole) for part, each in parts)


def friction_alarm(change: float) -> Alarm:
    beyond = change > 0.4
    category = Health.OUT_OF_SPECIFICATION if beyond else Health.MAINTENANCE_REQUIRED
    evidence = "sliding friction in 300 moves, 148 of them opening"
    limit = 0.4 if beyond else 0.2
    since = "2026-08-30T04:12:00Z"
    return Alarm(
        AlarmCause.FRICTION_HIGH, 2 if beyond else 1, category, 3.6e6, change, 0.01, limit, evidence, since=since
    )


def service(change: float, alarms: tuple[Alarm, ...] = ()) -> Service:
    """Return the service of a valve whose friction has changed by this part."""
    own = Configuration(valve=ValveParameters(id="FV-101")).health_settings.watch
    watch = replace(
        own, reference=reference_of(ValveParameters(id="FV-101"), signature=("2026-03-09T14:05:00Z", SIGNATURE))
    )
    normal, moves = (2e4, 0.0, 0.0, 1e4, 0.0, 2e4), 300
    trend = FrictionTrend(normal, (80.0, 60.0, 2e4 * change), 1.2, 0.5 * change, 40, moves, 148, 9e5)
    against = (watch.reference.source, watch.reference.recorded)
    return Service(counters(), Trends(against, trend, alarms=alarms), watch, "9 Mar 2026, 14:05 UTC", LATER)


def other_alarms() -> tuple[Alarm, ...]:
    """Return a spring force that has shifted, and a travel deviation that has ended."""
    spring, deviation = AlarmCause.SPRING_FORCE, AlarmCause.TRAVEL_DEVIATION
    evidence, since = "higher than the reference, in 300 moves", "2026-09-02T10:00:00Z"
    return (
        Alarm(spring, 1, Health.MAINTENANCE_REQUIRED, 3.7e6, 0.06, 0.004, 0.05, evidence, since=since),
        Alarm(
            deviation, 0, Health.OUT_OF_SPECIFICATION, 3.8e6, 0.001, 0.0, 0.05, "the stem stands at 80 mm", since=since
        ),
    )
