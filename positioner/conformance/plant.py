"""The rules of a plant, judged from its frames and from what the script sent it. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from positioner.conformance.cadence import Cadence
from positioner.conformance.frames import FRAME_RULES, FrameWatch
from positioner.conformance.rules import Finding, Ledger, Offence, Rule
from positioner.conformance.script import REFUSED, Act, Script
from positioner.wire.messages import ActuatorState, Quality, StemPosition

if TYPE_CHECKING:
    from positioner.wire.codec import Codec
    from positioner.wire.messages import CanFrame

_NS = 1_000_000_000
_PERIODS_TO_SETTLE = 5
_LEAST_SETTLE_S = 0.05
_PERIOD_TOLERANCE = 0.05
_HOLD_PERIODS = 3
_PATIENCE_S = 0.03
"""In HOLD the positioner repeats its command every 10 ms: a deadman must bear three of these."""
_FOLLOWS = "set CommandCounter to the counter of the newest command that was accepted, and Quality to VALID"
_OBEYS = frozenset({Quality.VALID, Quality.SUSPECT})
_REFUSES = "check {} before anything else of a frame is used, the deadman included"

PLANT_RULES = (
    Rule(
        "heard",
        "it sends STEM_POSITION",
        "check bus, bit rate, wiring and id_offset; the plant sends whether or not anybody answers",
    ),
    *FRAME_RULES,
    Rule("period", "STEM_POSITION comes every --period", "send it from a timer of that period, in every state"),
    Rule(
        "gaps", f"no gap is longer than {_HOLD_PERIODS} periods", "give the sender's task priority; HOLD begins there"
    ),
    Rule("travel", "positions lie within --travel", "check zero, span and sign of the sensor; Position_mm is in mm"),
    Rule(
        "first",
        "Quality is FAIL_POSITION, or FAULT, as long as no command acts",
        "say FAIL_POSITION from the start until the first accepted command, and while the deadman has fallen",
    ),
    Rule("echo", "CommandCounter names the newest accepted command", _FOLLOWS),
    Rule("obeys", "Quality is VALID, or SUSPECT, while commands come", _FOLLOWS),
    Rule(Act.REPEAT.name.lower(), "a repeated counter is refused, and no sign of life", _REFUSES.format("the counter")),
    Rule(Act.DAMAGE.name.lower(), "a wrong CRC is refused, and no sign of life", _REFUSES.format("the CRC")),
    Rule(Act.OLD.name.lower(), "an old counter is refused, and no sign of life", _REFUSES.format("the counter")),
    Rule(Act.SHORT.name.lower(), "a short frame is refused, and no sign of life", _REFUSES.format("the length")),
    Rule(
        "deadman",
        "without commands for --deadman it says FAIL_POSITION",
        "go to the fail position by yourself, and say so with every reading",
    ),
    Rule(
        "patience",
        f"it obeys on for {_PATIENCE_S * 1e3:g} ms without a command",
        "let the deadman fall later: the positioner repeats its command every 10 ms only while it holds",
    ),
    Rule("rejoins", "the next accepted command ends the fail position", "end it with the first accepted command"),
    Rule(
        "restart",
        "a controller that has restarted is obeyed from its second command on",
        "take a counter over that was refused, when the next frame follows it",
    ),
    Rule(
        "failure-signal",
        "a current of at most 3.6 mA is a failure signal: FAIL_POSITION at once",
        "compare the current with the failure signals of NAMUR NE 43, at most 3.6 mA and at least 21 mA",
    ),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class PlantLimits:
    """What is known of the plant: period in s, deadman in s, travel in m, None where it is not told."""

    period_s: float
    deadman_s: float
    travel_m: tuple[float, float] | None = None

    @property
    def settle_s(self) -> float:
        """How long an answer may take, in s: some periods, and what a computer without real time needs."""
        return max(_PERIODS_TO_SETTLE * self.period_s, _LEAST_SETTLE_S)


class PlantExamination:
    """Judges a plant frame by frame; mutable. The shell sends what `hear` returns."""

    def __init__(self, codec: Codec, limits: PlantLimits, script: Script, id_offset: int = 0) -> None:
        """Begin before the first frame."""
        self._limits = limits
        self._script = script
        self._ledger = Ledger(PLANT_RULES)
        self._watch = FrameWatch(codec, (StemPosition, ActuatorState), self._ledger, id_offset)
        self._cadence = Cadence(self._ledger, {"gaps": _HOLD_PERIODS * limits.period_s})

    def at(self, now_ns: int) -> bool:
        """Let time pass; return False when the examination is over."""
        return self._script.at(now_ns)

    def hear(self, frame: CanFrame, now_ns: int) -> CanFrame | None:
        """Judge `frame`, and return what to send at `now_ns`, after it."""
        heard = self._watch.hear(frame)
        if heard is None:
            return None
        reading, counter = heard
        if not isinstance(reading, StemPosition):
            return None
        self._ledger.keep("heard")
        self._cadence.hear(frame)
        if self._limits.travel_m is not None and reading.quality is not Quality.FAULT:
            low_m, high_m = self._limits.travel_m
            told = f"Position_mm = {reading.position_m * 1e3:g}"
            inside = low_m <= reading.position_m <= high_m
            self._ledger.judge("travel", None if inside else Offence(told, frame))
        self._judge(reading, frame)
        return self._script.answer(counter, now_ns)

    def findings(self, now_ns: int) -> tuple[Finding, ...]:
        """Return the verdicts at the end of the examination."""
        self._cadence.end(now_ns)
        if self._cadence.first_ns is None:
            self._ledger.offend("heard", Offence("no STEM_POSITION came"))
        elif (mean_s := self._cadence.mean_s) is not None:
            period_s = self._limits.period_s
            told = f"the mean period is {mean_s * 1e3:.4g} ms instead of {period_s * 1e3:.4g} ms"
            right = abs(mean_s - period_s) <= _PERIOD_TOLERANCE * period_s
            self._ledger.judge("period", None if right else Offence(told))
        return self._ledger.findings()

    def _judge(self, reading: StemPosition, frame: CanFrame) -> None:
        """Judge what a reading says of the commands, as soon as the act has had time to be heard."""
        script, settle_ns = self._script, round(self._limits.settle_s * _NS)
        now_ns = frame.received_ns
        steady_s = (now_ns - script.steady_ns) / _NS
        silent_s = (now_ns - script.sent[-1].instant_ns) / _NS if script.sent else 0.0
        failed = reading.quality in {Quality.FAIL_POSITION, Quality.FAULT}
        quality = f"Quality = {reading.quality.name}"
        match script.act:
            case Act.LISTEN:
                if steady_s > self._limits.deadman_s + self._limits.settle_s:
                    self._ledger.judge("first", None if failed else Offence(quality, frame))
            case Act.SILENCE:
                told = f"{quality} {silent_s:.4f} s after the last command"
                if silent_s <= _PATIENCE_S:
                    self._ledger.judge("patience", Offence(told, frame) if failed else None)
                elif silent_s > self._limits.deadman_s + self._limits.settle_s:
                    self._ledger.judge("deadman", None if failed else Offence(told, frame))
            case act if act in REFUSED:
                self._judge_refusal(act, reading, frame, silent_s)
            case _ if steady_s <= self._limits.settle_s or silent_s > script.steady_gap_s:
                pass  # too early, or our own commands had a gap
            case Act.FAIL:
                told = f"{quality} under a failure signal"
                self._ledger.judge("failure-signal", None if failed else Offence(told, frame))
            case act:
                recent = {each.counter for each in script.sent if now_ns - each.instant_ns <= settle_ns}
                recent.add(script.sent[-1].counter)
                echo = f"CommandCounter = {reading.command_counter}, and {script.sent[-1].counter} was sent last"
                self._ledger.judge("echo", None if reading.command_counter in recent else Offence(echo, frame))
                name = "restart" if act is Act.RESTART else "obeys" if script.is_first_command else "rejoins"
                self._ledger.judge(name, Offence(f"{quality} while commands come", frame) if failed else None)

    def _judge_refusal(self, act: Act, reading: StemPosition, frame: CanFrame, silent_s: float) -> None:
        if silent_s <= self._limits.settle_s:
            return
        last = self._script.sent[-1].counter
        fallen = silent_s > self._limits.deadman_s + self._limits.settle_s
        told = ""
        if reading.command_counter != last:
            told = f"CommandCounter = {reading.command_counter}, though the last command to be accepted has {last}"
        elif fallen and reading.quality in _OBEYS:
            told = f"Quality = {reading.quality.name} {silent_s:.3f} s after the last command to be accepted"
        if told:
            self._ledger.offend(act.name.lower(), Offence(told, frame))
        elif fallen:
            self._ledger.keep(act.name.lower())
