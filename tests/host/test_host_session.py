"""The host with the positioner and the emulated valve, in virtual time: the effect of each verb."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import pytest
from virtual_bench import TEXT, Bench

from positioner.cycle.state import CycleState
from positioner.errors import HostError
from positioner.host.session import ANSWER_S, RELEASED_S, HostSession
from positioner.host.verbs import Verb, Word
from positioner.values import replace
from positioner.wire.messages import (
    HostRequest,
    ManualCurrent,
    ManualRequest,
    Mode,
    Setpoint,
    StemPosition,
)

PERCENT = Path(__file__).parents[2] / "examples" / "percent.toml"


def test_before_the_first_verb_not_a_frame_is_sent() -> None:
    it = Bench()
    it.say("help")
    it.say("status")
    assert it.sent == []
    assert not it.session.is_sending


def test_the_status_tells_a_positioner_that_was_never_armed_from_one_that_does_not_run() -> None:
    it = Bench()
    it.say("status")
    assert "mode      READY: waits to be armed (NE 107: function check)" in it.session.lines
    assert "armed     no" in it.session.lines
    it.positioner_is_on = False
    it.run(1.0)
    with pytest.raises(HostError, match="silent: `positioner run` does not run on this bus with this configuration"):
        it.say("status", within_s=2.0)


def test_a_refused_verb_sends_nothing() -> None:
    it = Bench()
    with pytest.raises(HostError, match="there is no present current to keep"):
        it.say("manual")
    it.run(0.5)
    assert it.sent == []
    assert not it.session.is_sending


def test_arm_sends_another_request_first_and_then_arm_until_the_positioner_is_armed() -> None:
    it = Bench()
    it.say("arm")
    assert it.is_in(Mode.ACTIVE)
    requests = [message.request for message in it.sent if isinstance(message, Setpoint)]
    first = requests.index(HostRequest.ARM)
    assert first == pytest.approx(RELEASED_S / 0.01, abs=1)
    assert requests[:first] == [HostRequest.DISARM] * 2 + [HostRequest.NONE] * (first - 2)
    it.sent.clear()
    it.run(0.5)
    assert {message.request for message in it.sent if isinstance(message, Setpoint)} == {HostRequest.NONE}
    assert len(it.sent) == pytest.approx(50, abs=1)
    assert it.reported("ACTIVE") == ["ACTIVE: controls the valve (NE 107: good)"]


def test_arm_alone_leaves_the_stem_where_it_is() -> None:
    it = Bench()
    before_m = it.true_m
    it.say("arm")
    it.run(1.0)
    assert it.true_m == pytest.approx(before_m, abs=0.0015)


def test_set_moves_the_stem_and_its_end_leads_to_hold_and_failsafe() -> None:
    it = Bench()
    it.say("arm set 62%")
    it.run(2.0)
    assert it.true_m == pytest.approx(0.62 * 0.127, abs=0.0015)
    it.host_is_on = False
    it.run(0.48)
    assert it.is_in(Mode.ACTIVE)
    it.run(0.06)
    assert it.is_in(Mode.HOLD)
    it.run(9.6)
    assert it.is_in(Mode.FAILSAFE)
    assert it.reported("HOLD") == ["HOLD: the host sends no setpoint any more (NE 107: out of specification)"]


def test_set_before_arm_waits_for_it() -> None:
    it = Bench()
    it.say("set 80")
    assert it.reported("setpoint") == ["setpoint 80.00 mm (62.99 %); it acts as soon as the positioner is armed: `arm`"]
    it.run(0.5)
    assert it.is_in(Mode.READY)
    it.say("arm")
    it.run(1.5)
    assert it.true_m == pytest.approx(0.08, abs=0.0015)


def test_disarm_makes_the_positioner_silent_and_ends_the_setpoints() -> None:
    it = Bench()
    it.say("arm set 80")
    it.run(0.5)
    it.say("disarm")
    assert it.is_in(Mode.READY)
    assert not it.session.is_sending
    it.sent.clear()
    it.run(0.5)
    assert it.sent == []
    assert it.session.lines[-1] == "disarmed: the positioner commands nothing"
    it.say("arm")
    assert it.is_in(Mode.ACTIVE)


def test_disarm_needs_no_answer() -> None:
    it = Bench()
    it.positioner_is_on = it.plant_is_on = False
    it.run(1.0)
    it.say("disarm")
    requests = {message.request for message in it.sent if isinstance(message, Setpoint)}
    assert requests == {HostRequest.DISARM}


def test_a_second_host_disarms_without_a_fault_and_the_first_one_says_so_and_stops() -> None:
    it = Bench()
    it.say("arm set 80")
    it.run(0.5)
    it.second = HostSession(it.configuration)
    it.run(0.6)
    counted = it.state.counters.by_cause
    it.second.begin(Verb(Word.DISARM), it.now_ns)
    it.run(0.2)
    assert it.is_in(Mode.READY)
    assert it.state.counters.by_cause == counted
    assert it.state.link.senders[Setpoint].window.errors == 0
    assert it.second.lines[-1] == "disarmed: the positioner commands nothing"
    assert not it.session.is_sending
    assert it.session.lines[-2:] == [
        "READY: disarmed (NE 107: function check)",
        "another host has disarmed the positioner: no more setpoints are sent; `arm` arms it again",
    ]
    it.sent.clear()
    it.run(1.0)
    assert it.sent == []
    it.say("arm")
    assert it.is_in(Mode.ACTIVE)
    assert it.state.counters.by_cause == counted


@pytest.mark.parametrize("end", ["disarm", "none"])
def test_a_host_that_comes_after_another_goes_on_in_its_sequence(end: str) -> None:
    it = Bench()
    it.say("arm set 80")
    it.run(0.9)
    if end == "disarm":
        it.say("disarm")
    it.session = HostSession(it.configuration)
    it.run(0.7)
    counted = it.state.counters.by_cause
    it.say("arm set 85")
    assert it.is_in(Mode.ACTIVE)
    it.run(1.0)
    assert it.state.counters.by_cause == counted
    assert it.true_m == pytest.approx(0.085, abs=0.0015)


def test_a_positioner_that_has_started_again_is_told_and_gets_no_more_setpoints() -> None:
    it = Bench()
    it.say("arm set 80")
    it.run(0.5)
    it.state = CycleState()
    it.run(0.2)
    assert it.session.lines[-1].startswith("the positioner has started again and is not armed: no more setpoints")
    assert not it.session.is_sending


def test_in_failsafe_and_unarmed_no_key_moves_the_setpoint_and_the_line_names_how_to_arm() -> None:
    it = Bench()
    up = Verb(Word.SET, step_percent=1.0)
    with pytest.raises(HostError, match=r"^no step: READY: waits to be armed \(.*\); `arm` arms it$"):
        it.session.stepped(up, it.now_ns)
    it.say("arm set 80")
    it.run(0.5)
    assert it.session.stepped(up, it.now_ns).setpoint_m == pytest.approx(0.08127)
    it.plant_is_on = False
    it.run(0.5)
    assert it.is_in(Mode.FAILSAFE)
    assert it.session.lines[-1] == "FAILSAFE stays until the positioner is armed again: `arm`"
    with pytest.raises(HostError, match=r"^no step: FAILSAFE: no position frames come \(.*\); `arm` arms it$"):
        it.session.stepped(up, it.now_ns)
    assert it.session.end_line(it.now_ns).startswith("no more setpoints are sent: the positioner stays in FAILSAFE")


def test_the_last_line_says_what_the_positioner_will_do_in_its_mode() -> None:
    it = Bench()
    assert it.session.end_line(it.now_ns).endswith("the positioner is not armed and commands nothing")
    it.say("arm")
    assert "holds within 0.5 s and fails safe after 10 s" in it.session.end_line(it.now_ns)
    it.setup = replace(it.setup, testing=True)
    it.run(0.5)
    assert it.session.end_line(it.now_ns).endswith(
        "a test procedure moves the valve and goes on without; `disarm` ends it"
    )
    it.positioner_is_on = False
    it.run(1.0)
    assert it.session.end_line(it.now_ns) == "no more setpoints are sent; the positioner is silent"
    with pytest.raises(HostError, match=r"the positioner is silent: `positioner run` does not run .* configuration$"):
        it.session.stepped(Verb(Word.SET, step_percent=1.0), it.now_ns)


def test_manual_mode_and_back_without_a_bump() -> None:
    it = Bench()
    it.say("arm set 85")
    it.run(1.5)
    before_ma = it.state.output.last_ma
    it.say("manual")
    assert it.is_in(Mode.MANUAL)
    it.run(0.5)
    assert it.state.output.last_ma == pytest.approx(before_ma, abs=1e-3)
    learned = it.state.counters.learned
    it.say("manual 19mA")
    it.run(1.5)
    assert it.state.output.last_ma == 19.0
    moved_m = it.true_m
    assert moved_m > 0.09
    it.currents.clear()
    it.say("auto")
    assert it.is_in(Mode.ACTIVE)
    it.run(1.5)
    assert it.currents[0] == 19.0
    assert max(abs(one - other) for one, other in pairwise(it.currents)) < 0.5
    assert it.true_m == pytest.approx(moved_m, abs=0.0015)
    assert it.state.control.setpoint_m == pytest.approx(moved_m, abs=0.0015)
    assert it.state.counters.learned - learned <= 1
    it.say("set 85")
    it.run(1.5)
    assert it.true_m == pytest.approx(0.085, abs=0.0015)


def test_the_frames_of_manual_mode_come_at_their_period_and_end_with_auto() -> None:
    it = Bench()
    it.say("arm manual 14mA")
    it.sent.clear()
    it.run(1.0)
    by_hand = [message for message in it.sent if isinstance(message, ManualCurrent)]
    assert len(by_hand) == pytest.approx(20, abs=1)
    assert set(by_hand) == {ManualCurrent(14.0)}
    it.sent.clear()
    it.say("auto")
    it.run(1.0)
    by_hand = [message for message in it.sent if isinstance(message, ManualCurrent)]
    assert {message.request for message in by_hand} == {ManualRequest.AUTO}
    assert 1 <= len(by_hand) <= 5


def test_a_new_manual_current_is_sent_at_once() -> None:
    it = Bench()
    it.say("arm manual 14mA")
    it.run(0.521)
    it.session.begin(Verb(Word.MANUAL, current_ma=14.5), it.now_ns)
    it.run(0.004)
    assert it.state.output.last_ma == 14.5


def test_with_a_dead_sensor_the_valve_is_moved_by_hand() -> None:
    it = Bench()
    it.say("arm set 80")
    it.run(1.0)
    it.plant_is_on = False
    it.run(1.0)
    assert it.is_in(Mode.FAILSAFE)
    with pytest.raises(HostError, match="set: no position frames come"):
        it.say("set 85")
    it.say("manual 12mA")
    assert it.is_in(Mode.FAILSAFE)
    it.say("arm")
    assert it.is_in(Mode.MANUAL)
    it.say("manual 13mA")
    it.run(0.1)
    assert it.state.output.last_ma == 13.0
    assert it.reported("MANUAL") == ["MANUAL: no position frames come (NE 107: function check)"]


@pytest.mark.parametrize(
    ("before", "verb", "line"),
    [
        ("arm manual 14mA", "set 80", "set: the valve is in manual mode: use `auto` first"),
        ("arm", "auto", "auto: the valve is in automatic mode already"),
        ("", "manual", "manual: there is no present current to keep: give one, as in `manual 9.5mA`"),
    ],
)
def test_a_verb_that_cannot_be_done_now_is_refused_in_one_line(before: str, verb: str, line: str) -> None:
    it = Bench()
    it.say(before)
    with pytest.raises(HostError) as caught:
        it.say(verb)
    assert str(caught.value) == line
    it.run(0.2)


@pytest.mark.parametrize(("verb", "word"), [("arm", "arm"), ("set 80", "set"), ("auto", "auto")])
def test_without_position_frames_nothing_begins(verb: str, word: str) -> None:
    it = Bench()
    it.plant_is_on = False
    it.run(0.6)
    with pytest.raises(HostError, match=f"{word}: no position frames come: is this the right bus"):
        it.say(verb)
    it.run(0.2)
    assert it.sent == []


def test_an_arm_without_an_answer_says_why_that_may_be() -> None:
    it = Bench()
    it.positioner_is_on = False
    with pytest.raises(HostError, match="arm: position frames come, but the positioner is silent"):
        it.say("arm", within_s=ANSWER_S + 1.0)


def test_an_arm_that_is_refused_says_why() -> None:
    it = Bench()
    it.say("arm disarm")
    it.session.begin(Verb(Word.ARM), it.now_ns)
    it.foreign_every = 100
    with pytest.raises(HostError, match="arm: not done within 3 s: READY: another controller commands this valve"):
        it.run(4.0)


def test_another_host_is_reported_before_and_while_this_one_sends() -> None:
    it = Bench()
    it.host_is_on = False
    it.others = [it.codec.encode(Setpoint(0.08), 0)]
    it.run(0.01)
    it.host_is_on = True
    with pytest.raises(HostError, match="arm: another host sends setpoints to this valve: stop it first"):
        it.say("arm")
    it.run(0.6)
    it.say("arm")
    assert it.reported("another host") == []
    it.session.receive([it.codec.encode(Setpoint(0.08), 0)], it.now_ns)
    it.session.receive([it.codec.encode(Setpoint(0.08), 1)], it.now_ns)
    assert it.reported("another host") == ["another host sends setpoints to this valve, too: stop one of them"]


def test_arm_is_no_mistake_where_the_positioner_is_armed_and_ends_its_hold() -> None:
    it = Bench()
    it.say("arm set 80")
    it.run(1.0)
    it.session = HostSession(it.configuration)
    it.run(1.0)
    assert it.is_in(Mode.HOLD)
    it.say("arm")
    assert it.reported("armed already") == ["the positioner was armed already"]
    it.run(0.5)
    assert it.is_in(Mode.ACTIVE)
    assert it.true_m == pytest.approx(0.08, abs=0.002)


def test_the_status_shows_every_quantity() -> None:
    it = Bench()
    it.say("arm set 80")
    it.run(2.0)
    it.session.lines.clear()
    it.say("status")
    lines = dict(line.split(maxsplit=1) for line in it.session.lines)
    assert list(lines) == ["mode", "armed", "table", "position", "setpoint", "error", "current", "alarms", "counters"]
    assert lines["mode"] == "ACTIVE: controls the valve (NE 107: good)"
    assert (lines["armed"], lines["table"]) == ("yes", "saved")
    assert lines["setpoint"] == "80.00 mm (62.99 %)"
    assert float(lines["position"].split()[0]) == pytest.approx(it.true_m * 1e3, abs=0.5)
    assert float(lines["error"].split()[0]) == pytest.approx((it.true_m - 0.08) * 1e3, abs=0.5)
    assert float(lines["current"].split()[0]) == pytest.approx(it.state.output.last_ma, abs=1e-3)
    assert lines["alarms"] == "none"
    assert lines["counters"].startswith(f"learned {it.state.counters.learned}, refused 0, fallbacks 0")
    it.plant_is_on = False
    it.run(1.0)
    it.session.lines.clear()
    it.say("status")
    assert "position  no position frames come" in it.session.lines


def test_a_positioner_that_falls_silent_is_reported_once() -> None:
    it = Bench()
    it.say("arm")
    it.positioner_is_on = False
    it.run(2.0)
    assert it.reported("silent") == ["the positioner is silent"]


def test_a_damaged_frame_is_ignored() -> None:
    it = Bench()
    good = it.codec.encode(StemPosition(0.08), 0)
    session = HostSession(it.configuration)
    session.receive([type(good)(good.arbitration_id, bytes(8))], 0)
    assert session.view.position_m is None
    session.receive([good], 1)
    assert session.view.position_m == pytest.approx(0.08)


def test_a_short_timeout_of_the_positioner_shortens_the_period_of_the_setpoints() -> None:
    it = Bench(TEXT + "[guard]\nsetpoint_hold_s = 0.02\nsetpoint_failsafe_s = 0.0\n")
    it.say("arm")
    it.sent.clear()
    it.run(1.0)
    assert len(it.sent) == pytest.approx(250, abs=2)
    assert it.is_in(Mode.ACTIVE)


def percent() -> str:
    """Return the example with frames in percent, at the period of these tests."""
    text = PERCENT.read_text("utf-8").replace("sample_period_s = 0.005", "sample_period_s = 0.002")
    return text.replace("percent.dbc", str(PERCENT.with_suffix(".dbc")))


def test_a_host_arms_and_moves_over_the_frames_of_a_users_dbc() -> None:
    bench = Bench(percent())
    bench.session.begin(Verb(Word.ARM), bench.now_ns)
    bench.run(0.5)
    assert bench.is_in(Mode.ACTIVE)
    bench.session.begin(Verb(Word.SET, setpoint_m=0.08), bench.now_ns)
    bench.run(1.0)
    assert bench.session.view.position_m == pytest.approx(0.08, abs=2e-3)
    bench.session.begin(Verb(Word.DISARM), bench.now_ns)
    bench.run(0.5)
    assert bench.is_in(Mode.READY)


@pytest.mark.parametrize("word", [Word.ARM, Word.DISARM])
def test_a_setpoint_frame_without_a_request_can_neither_arm_nor_disarm(word: Word) -> None:
    bench = Bench(percent().replace(', request = "Release"', ""))
    with pytest.raises(HostError, match="maps no signal to `request`: map one, or set guard"):
        bench.session.begin(Verb(word), bench.now_ns)
    assert bench.session.advance(bench.now_ns) == ()
