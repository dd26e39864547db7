"""One valve as its frames show it: frames in, what a view shows out, the same from a bus and from a log. Pure.

Instants are in ns of any clock that runs evenly: the machine's monotonic one, or the time of a log.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

from positioner.host.valve_view import SILENT_S
from positioner.host.words import alarms_in_words, named_counters, state_in_words, status_counts
from positioner.monitor.rates import Rate
from positioner.monitor.trend import Trend
from positioner.monitor.view import Seen, View
from positioner.wire.e2e import CounterCheck, Sequence
from positioner.wire.formats import FrameRejectedError
from positioner.wire.messages import (
    ActuatorState,
    Counted,
    CurrentCommand,
    ManualCurrent,
    PositionerAlarms,
    PositionerCount,
    PositionerStatus,
    Quality,
    Setpoint,
    StemPosition,
)

if TYPE_CHECKING:
    from positioner.config.schema import Configuration
    from positioner.wire.messages import CanFrame, Message

SHOWN: tuple[type[Message], ...] = (
    *(StemPosition, CurrentCommand, Setpoint, ManualCurrent, ActuatorState),
    *(PositionerStatus, PositionerCount, PositionerAlarms),
)
"""The messages that are looked at; the emulator's truth is none of them."""
_RATED: tuple[type[Message], ...] = (StemPosition, CurrentCommand, Setpoint, PositionerStatus)
_MEAN_BINS = 10
"""The shown position is the mean of the readings of so many bins, 0.1 s."""
_LATE_PERIODS = 2.0
_COUNTS = 256
"""The counters of the status are bytes."""
_NS = 1_000_000_000
_M = TypeVar("_M")


@dataclass(frozen=True, slots=True)
class StatusCounts:
    """The counters of the status, which it sends modulo 256, counted on since the first one that came.

    seen: as they came last, at `at_ns`. After a silence they begin anew: a positioner that was started again counts
    from 0, and in a long one more than 256 may have been counted.
    """

    totals: tuple[int, int, int] = (0, 0, 0)
    seen: tuple[int, int, int] = (0, 0, 0)
    at_ns: int | None = None

    def after(self, counts: tuple[int, int, int], now_ns: int) -> StatusCounts:
        """Return the counters after a status."""
        if self.at_ns is None or now_ns - self.at_ns > SILENT_S * _NS:
            return StatusCounts(counts, counts, now_ns)
        learned, refused, fallbacks = (
            total + (count - before) % _COUNTS
            for total, before, count in zip(self.totals, self.seen, counts, strict=True)
        )
        return StatusCounts((learned, refused, fallbacks), counts, now_ns)


class ValveModel:
    """One valve; `add` takes its frames, oldest first."""

    def __init__(self, configuration: Configuration) -> None:
        """Begin with nothing received."""
        self._codec = configuration.make_codec()
        self.valve = configuration.valve
        self._late_ns = round(_LATE_PERIODS * configuration.control.sample_period_s * _NS)
        margin_m = configuration.guard.position_margin_m
        self._plausible_m = self.valve.travel_min_m - margin_m, self.valve.travel_max_m + margin_m
        self.identifiers = tuple(self._codec.identifier(kind) for kind in SHOWN)
        self.trend = Trend()
        self._newest: dict[type[Any], tuple[Message, int]] = {}
        self._checks: dict[type[Message], CounterCheck] = {}
        self._rates = {kind: Rate() for kind in _RATED}
        self._counts: dict[Counted, int] = {}
        self._status = StatusCounts()
        self._seen = Seen()

    def copy(self) -> ValveModel:
        """Return a model that goes on by itself."""
        new = object.__new__(ValveModel)
        new._codec, new.valve, new.identifiers = self._codec, self.valve, self.identifiers
        new._late_ns, new._plausible_m = self._late_ns, self._plausible_m
        new.trend = self.trend.copy()
        new._newest, new._checks, new._counts = self._newest.copy(), self._checks.copy(), self._counts.copy()
        new._status = self._status
        new._rates = {kind: rate.copy() for kind, rate in self._rates.items()}
        new._seen = self._seen
        return new

    def add(self, frame: CanFrame, now_ns: int) -> None:
        """Take in a frame of this valve, or an error frame, which is everyone's."""
        try:
            message, counter = self._codec.decode(frame)
        except FrameRejectedError as error:
            if error.counted is not None:
                self._seen = self._seen.plus(damaged=1)
            return
        kind = type(message)
        if kind in SHOWN and self._is_in_sequence(kind, counter, now_ns):
            self._newest[kind] = message, now_ns
            if kind in self._rates:
                self._rates[kind].add(now_ns)
            self._use(message, now_ns)

    def _is_in_sequence(self, kind: type[Message], counter: int | None, now_ns: int) -> bool:
        """Count what is lost, late or twice; return whether the message is a new one."""
        before = self._newest.get(kind)
        lost = 0
        # three kinds share the counter of the status, and two of them do not always come
        if counter is not None and kind not in {PositionerCount, PositionerAlarms}:
            modulus = self._codec.by_kind[kind].counter_modulus
            known = self._checks.get(kind) or CounterCheck(modulus=modulus)
            self._checks[kind], verdict, lost = known.check(counter)
            if verdict is not Sequence.FRESH:
                self._seen = self._seen.plus(disordered=1)
                return False
        if lost:
            self._seen = self._seen.plus(lost=lost)
        elif kind is StemPosition and before is not None and self._late_ns < now_ns - before[1] < SILENT_S * _NS:
            self._seen = self._seen.plus(late=1)
        return True

    def _use(self, message: Message, now_ns: int) -> None:
        match message:
            case StemPosition():
                low_m, high_m = self._plausible_m
                if not low_m <= message.position_m <= high_m:
                    self._seen = self._seen.plus(damaged=1)
                elif message.quality is not Quality.FAULT:
                    self.trend.position(message.position_m, now_ns)
            case CurrentCommand():
                self.trend.current(message.current_ma, now_ns)
            case Setpoint():
                self.trend.setpoint(message.setpoint_m, now_ns)
            case PositionerStatus():
                self._status = self._status.after(status_counts(message), now_ns)
            case PositionerCount():
                self._counts[message.counted] = message.count
            case _:
                pass

    def view(self, now_ns: int) -> View:
        """Return what is to be shown at the instant `now_ns`."""
        position = self._present(StemPosition, now_ns)
        setpoint, command = self._present(Setpoint, now_ns), self._present(CurrentCommand, now_ns)
        status, alarms = self._present(PositionerStatus, now_ns), self._present(PositionerAlarms, now_ns)
        pressure = self._present(ActuatorState, now_ns)
        mean_m = self.trend.mean_position_m(_MEAN_BINS, now_ns) if position else None
        return View(
            valve_id=self.valve.id,
            span_m=self.valve.span_m,
            time_s=now_ns / _NS,
            late_s=self._late_ns / _NS,
            position_m=mean_m if mean_m is not None or position is None else position.position_m,
            quality=position.quality.name if position else None,
            setpoint_m=setpoint.setpoint_m if setpoint else None,
            current_ma=command.current_ma if command else None,
            pressure_pa=pressure.pressure_pa if pressure else None,
            motion=command.motion.name if command else None,
            mode=status.mode.name if status else None,
            cause=status.cause.name if status else None,
            state=state_in_words(status) if status else self._silence(position),
            health=status.health.name if status else None,
            armed=status.armed if status else None,
            table_saved=status.table_saved if status else None,
            alarms=alarms_in_words(alarms),
            counters=named_counters(self._status.totals, self._counts) if status else None,
            rates=tuple((kind.__name__, rate.per_s(now_ns)) for kind, rate in self._rates.items()),
            seen=self._seen,
        )

    def _present(self, kind: type[_M], now_ns: int) -> _M | None:
        """Return the newest message of this kind, None where its sender is silent."""
        found = self._newest.get(kind)
        if found is None or now_ns - found[1] > SILENT_S * _NS:
            return None
        assert isinstance(found[0], kind)  # noqa: S101 - for the type checker: it is kept by its kind
        return found[0]

    def _silence(self, position: StemPosition | None) -> str:
        """Return in words why there is no status."""
        if position is None:
            return "nothing comes: neither position frames nor a status"
        return "position frames come, the positioner is silent: it does not run on this bus with this configuration"
