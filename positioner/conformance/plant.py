"""The rules of a plant, checked on its frames and its reaction to the script's commands. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from positioner.conformance.frames import FRAME_RULES, FrameChecks, check_travel
from positioner.conformance.rules import Results, Rule, RuleResult, Violation
from positioner.conformance.script import REFUSED, Phase, Script
from positioner.conformance.timing import FrameTiming
from positioner.inputs.durations import duration
from positioner.wire.messages import ActuatorState, Quality, StemPosition

if TYPE_CHECKING:
    from positioner.wire.codec import Codec
    from positioner.wire.messages import CanFrame

_NS = 1_000_000_000
_PERIODS_TO_SETTLE = 5
_LEAST_SETTLE_S = 0.05
_PERIOD_TOLERANCE = 0.05
_HOLD_PERIODS = 3
_GRACE_S = 0.03
"""In HOLD the positioner repeats its command every 10 ms: a deadman must be longer than three of these."""
_FOLLOWS = "set CommandCounter to the counter of the newest command that was accepted, and Quality to VALID"
_OBEYS = frozenset({Quality.VALID, Quality.SUSPECT})


def _refusal(phase: Phase, subject: str, checked: str) -> Rule:
    demands = f"a command with {subject} is refused, and does not restart the deadman"
    return Rule(phase.value, demands, f"check {checked} before anything else of a frame is used, the deadman included")


PLANT_RULES = (
    Rule(
        "received",
        "it sends STEM_POSITION",
        "check bus, bit rate, wiring and id_offset; the plant sends even if nobody answers",
    ),
    *FRAME_RULES,
    Rule("period", "STEM_POSITION comes every --period", "send it from a timer of that period, in every state"),
    Rule(
        "gaps",
        f"no gap is longer than {_HOLD_PERIODS} periods",
        "give the sender's task a higher priority; after a longer gap the positioner goes to HOLD",
    ),
    Rule("travel", "positions lie within --travel", "check zero, span and sign of the sensor; Position_mm is in mm"),
    Rule(
        "first",
        "Quality is FAIL_POSITION, or FAULT, as long as no command acts",
        "send FAIL_POSITION from the start until the first accepted command, and again after the deadman has expired",
    ),
    Rule("echo", "CommandCounter is the counter of the newest accepted command", _FOLLOWS),
    Rule("obeys", "Quality is VALID, or SUSPECT, while commands come", _FOLLOWS),
    _refusal(Phase.REPEAT, "a repeated counter", "the counter"),
    _refusal(Phase.DAMAGE, "a wrong CRC", "the CRC"),
    _refusal(Phase.OLD, "an old counter", "the counter"),
    _refusal(Phase.SHORT, "seven bytes", "the length"),
    Rule(
        "deadman",
        "without commands for --deadman it sends FAIL_POSITION",
        "go to the fail position without being asked, and send FAIL_POSITION with every reading",
    ),
    Rule(
        "grace",
        f"it obeys on for {_GRACE_S * 1e3:g} ms without a command",
        "make the deadman longer: while it holds, the positioner repeats its command only every 10 ms",
    ),
    Rule("rejoins", "the next accepted command ends the fail position", "end it with the first accepted command"),
    Rule(
        "restart",
        "a controller that has restarted is obeyed from its second command on",
        "accept a counter that was refused, when the next frame follows it",
    ),
    Rule(
        "failure-signal",
        "a current of at most 3.6 mA is a failure signal: FAIL_POSITION at once",
        "compare the current with the failure signals of NAMUR NE 43, at most 3.6 mA and at least 21 mA",
    ),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class PlantLimits:
    """The plant's period in s, its deadman in s, and its travel in m (None where it is not known)."""

    period_s: float
    deadman_s: float
    travel_m: tuple[float, float] | None = None

    @property
    def settle_s(self) -> float:
        """The time in s that an answer may take: some periods, at least the delay of a computer without real time."""
        return max(_PERIODS_TO_SETTLE * self.period_s, _LEAST_SETTLE_S)


class PlantTest:
    """Checks a plant frame by frame; mutable. The shell sends what `receive` returns."""

    def __init__(self, codec: Codec, limits: PlantLimits, script: Script, id_offset: int = 0) -> None:
        """Prepare a test that lasts as long as `script`."""
        self._limits = limits
        self._script = script
        self._results = Results(PLANT_RULES)
        self._frames = FrameChecks(codec, (StemPosition, ActuatorState), self._results, id_offset)
        self._positions = FrameTiming(self._results, {"gaps": _HOLD_PERIODS * limits.period_s})

    def goes_on(self, now_ns: int) -> bool:
        """Begin at the first call, go on to the next phase when it is due; return False when the test is over."""
        return self._script.goes_on(now_ns)

    def receive(self, frame: CanFrame, now_ns: int) -> CanFrame | None:
        """Check `frame`, and return the frame to send at `now_ns`, after it."""
        received = self._frames.receive(frame)
        if received is None:
            return None
        reading, counter = received
        if not isinstance(reading, StemPosition):
            return None
        self._results.passed("received")
        self._positions.receive(frame)
        if reading.quality is not Quality.FAULT:
            check_travel(self._results, self._limits.travel_m, "Position_mm", reading.position_m, frame)
        self._check_obedience(reading, frame)
        return self._script.answer(counter, now_ns)

    def results(self, now_ns: int) -> tuple[RuleResult, ...]:
        """End the test, and return the result for every rule."""
        self._positions.end(now_ns)
        if self._positions.first_ns is None:
            self._results.failed("received", Violation("no STEM_POSITION came"))
        elif (mean_s := self._positions.mean_s) is not None:
            period_s = self._limits.period_s
            found = f"the mean period is {duration(mean_s, 4)} instead of {duration(period_s, 4)}"
            right = abs(mean_s - period_s) <= _PERIOD_TOLERANCE * period_s
            self._results.note("period", None if right else Violation(found))
        return self._results.all()

    def _check_obedience(self, reading: StemPosition, frame: CanFrame) -> None:
        """Check counter and quality of `reading` against the commands, once the plant has had time to react."""
        script, limits, results = self._script, self._limits, self._results
        now_ns = frame.received_ns
        steady_s = (now_ns - script.steady_ns) / _NS
        silent_s = (now_ns - script.sent[-1].instant_ns) / _NS if script.sent else 0.0
        expired_s = limits.deadman_s + limits.settle_s
        failed = reading.quality not in _OBEYS
        quality = f"Quality = {reading.quality.name}"
        match script.phase:
            case Phase.LISTEN:
                if steady_s > expired_s:
                    results.note("first", None if failed else Violation(quality, frame))
            case Phase.SILENCE:
                found = f"{quality} {silent_s:.4f} s after the last command"
                if silent_s <= _GRACE_S:
                    results.note("grace", Violation(found, frame) if failed else None)
                elif silent_s > expired_s:
                    results.note("deadman", None if failed else Violation(found, frame))
            case phase if phase in REFUSED:
                self._check_refusal(phase.value, reading, frame, silent_s)
            case _ if steady_s <= limits.settle_s or silent_s > script.steady_gap_s:
                pass  # too early, or the test's own commands had a gap
            case Phase.FAIL:
                results.note("failure-signal", None if failed else Violation(f"{quality} on a failure signal", frame))
            case phase:
                settle_ns, newest = round(limits.settle_s * _NS), script.sent[-1].counter
                recent = {each.counter for each in script.sent if now_ns - each.instant_ns <= settle_ns} | {newest}
                echo = f"CommandCounter = {reading.command_counter}, and {newest} was sent last"
                results.note("echo", None if reading.command_counter in recent else Violation(echo, frame))
                name = "restart" if phase is Phase.RESTART else "obeys" if script.is_first_command else "rejoins"
                results.note(name, Violation(f"{quality} while commands come", frame) if failed else None)

    def _check_refusal(self, rule: str, reading: StemPosition, frame: CanFrame, silent_s: float) -> None:
        if silent_s <= self._limits.settle_s:
            return
        last = self._script.sent[-1].counter
        expired = silent_s > self._limits.deadman_s + self._limits.settle_s
        if reading.command_counter != last:
            found = f"CommandCounter = {reading.command_counter}, but the last good command has the counter {last}"
            self._results.failed(rule, Violation(found, frame))
        elif expired and reading.quality in _OBEYS:
            found = f"Quality = {reading.quality.name} {silent_s:.3f} s after the last good command"
            self._results.failed(rule, Violation(found, frame))
        elif expired:
            self._results.passed(rule)
