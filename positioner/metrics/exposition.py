"""The metrics of valves as OpenMetrics text (openmetrics.io, 1.0). Pure.

It uses gauges and counters only: so readers of Prometheus' older text format, like node_exporter's textfile collector,
take it, too. A state is a gauge for each of its values, 1 for the present one.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from positioner.metrics.names import ALARMS, CAUSES, EVENTS, HEALTH, MODES

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    Snapshot = Mapping[str, Any]
    Samples = Iterator[tuple[str, str, float]]
    """The name and the value of a further label, empty where there is none, and the value."""

FIRST_LINE = b"# TYPE positioner_build_info gauge\n"
"""How every text of ours begins, and no other program's."""
CONTENT_TYPE = "application/openmetrics-text; version=1.0.0; charset=utf-8"
_MA = 1e-3


@dataclass(frozen=True, slots=True)
class _Metric:
    """A family of metrics: its name without prefix and `_total`, what it tells, and its samples of one valve."""

    name: str
    help: str
    samples: Callable[[Snapshot], Samples]
    unit: str = ""
    is_counter: bool = False


def text_of(snapshots: Sequence[Snapshot], version: str) -> str:
    """Return the exposition of the newest snapshot of each valve."""
    lines = list(_head("build_info", "gauge", "", "The version of the positioner that runs."))
    lines.append(f'positioner_build_info{{version="{_escaped(version)}"}} 1')
    for metric in _METRICS:
        found = [
            (_labels(snapshot["valve"], label, value), number)
            for snapshot in snapshots
            for label, value, number in metric.samples(snapshot)
        ]
        if found:
            lines += _head(metric.name, "counter" if metric.is_counter else "gauge", metric.unit, metric.help)
            suffix = "_total" if metric.is_counter else ""
            lines += [f"positioner_{metric.name}{suffix}{{{labels}}} {number!r}" for labels, number in found]
    return "\n".join((*lines, "# EOF", ""))


def _head(name: str, kind: str, unit: str, text: str) -> Iterator[str]:
    yield f"# TYPE positioner_{name} {kind}"
    if unit:
        yield f"# UNIT positioner_{name} {unit}"
    yield f"# HELP positioner_{name} {text}"


def _labels(valve: str, label: str, value: str) -> str:
    own = f',{label}="{_escaped(value)}"' if label else ""
    return f'valve="{_escaped(valve)}"{own}'


def _escaped(text: str) -> str:
    return text.replace("\\", r"\\").replace('"', r"\"").replace("\n", r"\n")


def _number(key: str, factor: float = 1.0) -> Callable[[Snapshot], Samples]:
    """Return the samples of one number, none where it is not known."""

    def samples(snapshot: Snapshot) -> Samples:
        if (value := snapshot[key]) is not None:
            yield "", "", value * factor if factor != 1.0 else _plain(value)

    return samples


def _part(part: str, key: str, factor: float = 1.0) -> Callable[[Snapshot], Samples]:
    """Return the samples of one number of a part of the snapshot, none where there is no such part."""

    def samples(snapshot: Snapshot) -> Samples:
        if (numbers := snapshot[part]) is not None:
            yield "", "", numbers[key] * factor if factor != 1.0 else numbers[key]

    return samples


_kept, _shadow = partial(_part, "kept"), partial(_part, "shadow")
"""Counters that outlive the daemon, and what is known of the law in the shadow."""


def _shadow_moves(snapshot: Snapshot) -> Samples:
    if snapshot["shadow"] is not None:
        for name, count in snapshot["shadow"]["moves"].items():
            yield "law", name, count


def _one_of(key: str, label: str, names: Mapping[int, str]) -> Callable[[Snapshot], Samples]:
    """Return a sample for each value of a state."""

    def samples(snapshot: Snapshot) -> Samples:
        for number, name in names.items():
            yield label, name, int(snapshot[key] == number)

    return samples


def _alarms(snapshot: Snapshot) -> Samples:
    for bit, name in ALARMS.items():
        yield "alarm", name, snapshot["alarms"] >> bit & 1


def _events(snapshot: Snapshot) -> Samples:
    for number, name in EVENTS.items():
        yield "event", name, snapshot["events"].get(str(number), 0)


def _mode_seconds(snapshot: Snapshot) -> Samples:
    if snapshot["kept"] is not None:
        for number, name in MODES.items():
            yield "mode", name, snapshot["kept"]["mode_s"][str(number)]


def _position_ratio(snapshot: Snapshot) -> Samples:
    if snapshot["position_m"] is not None:
        yield "", "", snapshot["position_m"] / snapshot["span_m"]


def _plain(value: float | bool) -> float:
    return int(value) if isinstance(value, bool) else value


_METRICS = (
    _Metric("updated_timestamp_seconds", "When the daemon told this last.", _number("updated_s"), "seconds"),
    _Metric("position_meters", "Newest plausible reading of the stem position.", _number("position_m"), "meters"),
    _Metric("position_ratio", "The same, as a part of the span.", _position_ratio, "ratio"),
    _Metric("setpoint_meters", "Newest usable setpoint of the host.", _number("setpoint_m"), "meters"),
    _Metric("span_meters", "What positions in percent refer to.", _number("span_m"), "meters"),
    _Metric("current_amperes", "Loop current that was commanded last.", _number("current_ma", _MA), "amperes"),
    _Metric("pressure_pascals", "Newest actuator pressure.", _number("pressure_pa"), "pascals"),
    _Metric("sample_period_seconds", "Measured period of the position frames.", _number("period_s"), "seconds"),
    _Metric("mode", "Mode of the guard: 1 for the present one.", _one_of("mode", "mode", MODES)),
    _Metric("cause", "Why it is in its mode: 1 for the present cause.", _one_of("cause", "cause", CAUSES)),
    _Metric("health", "NAMUR NE 107 signal: 1 for the present one.", _one_of("health", "signal", HEALTH)),
    _Metric("armed", "Whether the host permits commands.", _number("armed")),
    _Metric("table_saved", "Whether all that was learned is on the disk.", _number("table_saved")),
    _Metric("table_cells", "Cells of the stiction table.", _number("table_cells")),
    _Metric("alarm", "Alarms of the condition of the valve: 1 for an active one.", _alarms),
    _Metric("refused_frames", "Frames that were not accepted.", _number("refused"), is_counter=True),
    _Metric("fallbacks", "Cycles in which the law could not do what it wanted.", _number("fallbacks"), is_counter=True),
    _Metric("learned_samples", "Samples that the stiction table has learned.", _number("learned"), is_counter=True),
    _Metric("events", "What the positioner counts, by its cause.", _events, is_counter=True),
    _Metric("travel_meters", "Way of the stem, kept over restarts.", _kept("travel_m"), "meters", is_counter=True),
    _Metric("reversals", "Changes of direction, kept over restarts.", _kept("reversals"), is_counter=True),
    _Metric("valve_cycles", "Reversals beyond the cycle dead band, kept.", _kept("cycles"), is_counter=True),
    _Metric("slips", "Edges from sticking to sliding, kept.", _kept("slips"), is_counter=True),
    _Metric("sticks", "Edges from sliding to sticking, kept.", _kept("sticks"), is_counter=True),
    _Metric("moves", "Moves that the law began, kept.", _kept("moves"), is_counter=True),
    _Metric("failed_pushes", "Pushes that freed nothing, kept.", _kept("failed_pushes"), is_counter=True),
    _Metric("observed_cycles", "Cycles of the loop that were counted, kept.", _kept("observed"), is_counter=True),
    _Metric("starts", "Starts of the positioner, kept.", _kept("starts"), is_counter=True),
    _Metric("stuck_seconds", "Time in which the stem stuck, kept.", _kept("stuck_s"), "seconds", is_counter=True),
    _Metric("mode_seconds", "Time in each mode, kept.", _mode_seconds, "seconds", is_counter=True),
    _Metric("shadow_cycles", "Cycles in which a law in the shadow was compared.", _shadow("cycles"), is_counter=True),
    _Metric(
        "shadow_differing_cycles",
        "Those of them in which its current differed by more than 0.1 mA.",
        _shadow("apart"),
        is_counter=True,
    ),
    _Metric("shadow_mean_difference_amperes", "Mean amount of the difference.", _shadow("mean_ma", _MA), "amperes"),
    _Metric("shadow_largest_difference_amperes", "Largest difference, signed.", _shadow("largest_ma", _MA), "amperes"),
    _Metric("shadow_moves", "Moves that each of the two laws began.", _shadow_moves, is_counter=True),
)
