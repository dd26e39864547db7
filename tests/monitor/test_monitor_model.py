"""A model of a valve: the numbers that its frames give, from a bus and from a log."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest
from monitor_helpers import ONE, PERIOD_NS, configured, frames_of
from user_dbc import USER_DBC

from positioner.monitor.canvas import Canvas
from positioner.monitor.curves import LABEL_WIDTH, plots
from positioner.monitor.model import ValveModel
from positioner.monitor.packed import PackedFrames
from positioner.monitor.playback import Playback
from positioner.monitor.trend import BIN_NS
from positioner.monitor.view import Seen
from positioner.wire.messages import (
    CanFrame,
    Cause,
    CurrentCommand,
    Health,
    Mode,
    PositionerStatus,
    Setpoint,
    StemPosition,
)

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

_NS = 1_000_000_000


def fed(model: ValveModel, frames: Sequence[CanFrame]) -> ValveModel:
    for frame in frames:
        model.add(frame, frame.received_ns)
    return model


def model_of(folder: Path, seconds: float = 3.0, begin_ns: int = 0) -> tuple[ValveModel, list[CanFrame]]:
    (configuration,) = configured(folder)
    frames = list(frames_of(configuration.make_codec(), seconds, begin_ns))
    return ValveModel(configuration), frames


def test_a_view_shows_what_the_frames_say(tmp_path: Path) -> None:
    model, frames = model_of(tmp_path)
    view = fed(model, frames).view(3 * _NS - 1)
    assert view.position_m == pytest.approx(0.060, abs=1e-5)  # the third second, after two slips
    assert view.error_m == pytest.approx(-0.002, abs=1e-5)
    assert view.current_ma == pytest.approx(12.0)
    assert (view.mode, view.cause, view.health) == ("ACTIVE", "NONE", "GOOD")
    assert view.state == "ACTIVE: controls the valve (NE 107: good)"
    assert view.counters == (("learned", 42), ("refused", 2), ("fallbacks", 3), ("frame lost", 5))
    rates = dict(view.rates)
    assert rates == pytest.approx({"StemPosition": 100, "CurrentCommand": 100, "Setpoint": 100, "PositionerStatus": 10})
    assert view.seen == replace(view.seen, lost=0, late=0, damaged=0, disordered=0)


def test_who_is_silent_is_not_shown_any_more(tmp_path: Path) -> None:
    model, frames = model_of(tmp_path)
    view = fed(model, frames).view(4 * _NS)
    assert (view.position_m, view.setpoint_m, view.current_ma, view.mode, view.health) == (None,) * 5
    assert view.state.startswith("nothing comes")
    assert dict(view.rates)["StemPosition"] == pytest.approx(50.0)
    assert dict(model.view(6 * _NS).rates)["StemPosition"] == 0.0


def test_frames_that_are_lost_late_damaged_or_twice_are_counted(tmp_path: Path) -> None:
    model, frames = model_of(tmp_path, 1.0)
    positions = [frame for frame in frames if frame.identifier == model.identifiers[0]]
    gone = set(positions[10:13])
    kept = [frame for frame in frames if frame not in gone]
    damaged = replace(positions[20], data=positions[20].data[:-1] + bytes((positions[20].data[-1] ^ 1,)))
    kept.insert(kept.index(positions[20]), damaged)
    kept.insert(kept.index(positions[30]) + 1, positions[30])
    kept = [
        replace(each, received_ns=each.received_ns + 2 * PERIOD_NS) if each is positions[-1] else each for each in kept
    ]
    kept = [each for each in kept if each is not positions[40]] + []
    seen = fed(model, kept).view(_NS).seen
    assert (seen.lost, seen.damaged, seen.disordered, seen.late) == (3 + 1, 1, 1, 1)


def test_the_same_frames_at_another_instant_give_the_same_view(tmp_path: Path) -> None:
    begin_ns = 5_000 * _NS
    early, frames = model_of(tmp_path)
    late, later = model_of(tmp_path, begin_ns=begin_ns)
    one, other = (fed(early, frames).view(3 * _NS), fed(late, later).view(begin_ns + 3 * _NS))
    assert replace(other, time_s=one.time_s) == one
    shift = begin_ns // BIN_NS
    bins = [each._replace(number=each.number - shift) for each in late.trend.since(-1)]
    assert bins == list(early.trend.since(-1))


def test_a_bin_keeps_the_lowest_and_the_highest_of_a_slip(tmp_path: Path) -> None:
    (configuration,) = configured(tmp_path)
    codec, model = configuration.make_codec(), ValveModel(configuration)
    for sample, position_m in enumerate((0.01, 0.03, 0.02)):
        model.add(codec.encode(StemPosition(position_m), sample), sample * 1_000_000)
    (only,) = model.trend.since(-1)
    assert (only.position_low_m, only.position_high_m) == pytest.approx((0.01, 0.03), abs=1e-5)
    assert only.position_mean_m == pytest.approx(0.02, abs=1e-5)
    assert only.readings == 3


def test_a_reading_far_outside_the_travel_is_counted_and_does_not_spoil_the_trend(tmp_path: Path) -> None:
    (configuration,) = configured(tmp_path)
    codec, model = configuration.make_codec(), ValveModel(configuration)
    for sample, position_m in enumerate((0.08, 0.5, -0.03, 0.08)):
        model.add(codec.encode(StemPosition(position_m), sample), sample * 1_000_000)
    (only,) = model.trend.since(-1)
    assert (only.position_low_m, only.position_high_m, only.readings) == (*[pytest.approx(0.08, abs=1e-5)] * 2, 2)
    assert model.view(5_000_000).seen.damaged == 2


def test_frames_of_a_users_dbc_are_shown_too(tmp_path: Path) -> None:
    (tmp_path / "valve.dbc").write_text(USER_DBC, "utf-8")
    wire = """
[wire]
dbc = "valve.dbc"
[wire.stem_position]
message = "Travel"
signals = { position_m = "Travel" }
[wire.setpoint]
message = "Target"
signals = { setpoint_m = "Target" }
[wire.current_command]
message = "Drive"
signals = { current_ma = "Demand" }
"""
    (configuration,) = configured(tmp_path, ONE + wire)
    codec, model = configuration.make_codec(), ValveModel(configuration)
    for sample in range(300):
        messages: tuple[Any, ...] = (Setpoint(0.05), StemPosition(0.0635), CurrentCommand(12.0))
        for message in messages:
            model.add(codec.encode(message, sample), sample * PERIOD_NS)
    view = model.view(3 * _NS - 1)
    assert (view.position_m, view.setpoint_m) == pytest.approx((0.0635, 0.05), abs=1e-4)
    assert view.current_ma == pytest.approx(12.0, abs=0.01)
    assert dict(view.rates)["StemPosition"] == pytest.approx(100.0)
    assert view.seen == Seen()


def played(folder: Path, seconds: float = 23.0) -> tuple[Playback, str]:
    model, frames = model_of(folder, seconds)
    packed = PackedFrames()
    for frame in frames:
        packed.add(frame, frame.received_ns)
    assert [replace(packed.frame(number), received_ns=packed.times_ns[number]) for number in range(99)] == frames[:99]
    return Playback(packed, {"FV-101": model}), "FV-101"


def reach(playback: Playback, to_s: float) -> None:
    playback.playing = False
    playback.seek(round(to_s * _NS))
    while not playback.advance(0.0):
        pass


def test_going_back_and_forth_gives_the_numbers_of_one_pass(tmp_path: Path) -> None:
    once, name = played(tmp_path)
    often, _ = played(tmp_path)
    for to_s in (18.31, 22.9, 7.77, 0.4, 12.345):
        reach(often, to_s)
    reach(once, 12.345)
    assert often.time_ns == once.time_ns == round(12.345 * _NS)
    assert often.models[name].view(often.time_ns) == once.models[name].view(once.time_ns)
    assert often.models[name].trend.since(-1) == once.models[name].trend.since(-1)


def test_a_log_plays_at_its_speed_stops_at_its_end_and_begins_again(tmp_path: Path) -> None:
    playback, _ = played(tmp_path, 2.0)
    playback.speed = 0.5
    playback.advance(1.0)
    assert playback.time_ns == pytest.approx(0.5 * _NS)
    playback.toggle()
    playback.advance(1.0)
    assert playback.time_ns == pytest.approx(0.5 * _NS)
    playback.toggle()
    playback.advance(100.0)
    assert (playback.time_ns, playback.playing) == (playback.end_ns, False)
    playback.toggle()
    assert (playback.time_ns, playback.playing) == (0, True)


def test_dots_are_where_they_belong() -> None:
    canvas = Canvas(2, 1)
    canvas.column(0, 0.0, 0.0, "a")
    canvas.column(3, 0.0, 1.0, "b")
    assert canvas.rows() == [[("⡀", "a"), ("⢸", "b")]]
    assert canvas.rows({"a": "*", "b": "+"}) == [[("*", "a"), ("+", "b")]]


def test_a_gap_is_a_gap_and_a_step_is_a_line() -> None:
    canvas = Canvas(16, 2)
    points: list[tuple[float, float] | None] = [None] * 32
    points[0] = points[1] = (0.0, 0.0)
    points[2] = (1.0, 1.0)
    points[20] = (0.0, 0.0)
    canvas.series(points, "a", parted={20})
    upper, lower = ("".join(text for text, _ in row) for row in canvas.rows())
    assert upper.rstrip() == " ⡇"
    assert lower.rstrip() == "⣀⡇" + 8 * " " + "⡀"
    canvas = Canvas(16, 2)
    canvas.series(points, "a")
    assert all("".join(text for text, _ in row)[1:10].strip() for row in canvas.rows()), "a slow sender is no gap"


def test_a_plot_fills_its_place_and_names_its_ends(tmp_path: Path) -> None:
    model, frames = model_of(tmp_path)
    bins = fed(model, frames).trend.since(-1)
    rows = plots(bins, 2.0, 3 * _NS, 80, 13, 0.02)
    assert [sum(len(text) for text, _ in row) for row in rows] == [80] * 13
    labels = [row[0][0].strip() for row in rows]
    assert [each for each in labels[:-1] if each] == ["64", "62", "60 mm", "12.2", "12.0", "11.8 mA"]
    assert (labels[0], labels[7], labels[8], labels[11]) == ("64", "60 mm", "12.2", "11.8 mA")
    pens = {pen for row in rows[:-1] for text, pen in row[1:] if text.strip()}
    assert pens == {"position", "setpoint", "command"}
    assert rows[0][0][0] == f"{'64':>{LABEL_WIDTH - 1}} "


def columns_with(pen: str, rows: Sequence[Sequence[tuple[str, str]]]) -> set[int]:
    """Return the columns of the plots in which a pen has drawn."""
    found = set[int]()
    for row in rows[:-1]:
        at = 0
        for text, of in row:
            found |= {at + number for number, each in enumerate(text) if of == pen and each.strip()}
            at += len(text)
    return found


@pytest.mark.parametrize("size", [(80, 13), (140, 40), (40, 7)])
@pytest.mark.parametrize(("begin_s", "end_s"), [(1.0, 1.4), (1.0, 2.5)])
def test_a_time_without_readings_is_a_gap_in_the_trend(
    tmp_path: Path, size: tuple[int, int], begin_s: float, end_s: float
) -> None:
    model, frames = model_of(tmp_path)
    fed(model, [each for each in frames if not begin_s * _NS < each.received_ns < end_s * _NS])
    rows = plots(model.trend.since(-1), 3.0, 3 * _NS, *size, model.view(3 * _NS).late_s)
    wide = size[0] - LABEL_WIDTH
    inside = {
        LABEL_WIDTH + column
        for column in range(wide)
        if begin_s + 0.1 < column * 3.0 / wide and (column + 1) * 3.0 / wide < end_s - 0.1
    }
    assert inside
    for pen in ("position", "setpoint", "command"):
        drawn = columns_with(pen, rows)
        assert not drawn & inside, "nothing is drawn where nothing came"
        assert len(drawn) > 0.3 * (wide - len(inside)) / (2 if pen == "setpoint" else 1)


def test_the_times_below_the_trend_are_round_and_stand_under_their_columns(tmp_path: Path) -> None:
    model, frames = model_of(tmp_path)
    for window_s, width, times in ((10.0, 80, [-10.0, -8.0, -6.0, -4.0, -2.0, 0.0]), (60.0, 40, [-50.0, 0.0])):
        ((line, _),) = plots(fed(model, frames).trend.since(-1), window_s, 3 * _NS, width, 12, 0.02)[-1]
        assert [float(each.replace("\N{MINUS SIGN}", "-")) for each in line.split(" s")[:-1]] == times
        assert line.index(f"{times[-2]:g} s".replace("-", "\N{MINUS SIGN}")) == LABEL_WIDTH + round(
            (width - LABEL_WIDTH - 1) * (1.0 + times[-2] / window_s)
        )
        assert line.endswith("0 s")


def status(learned: int, refused: int = 0, fallbacks: int = 0) -> PositionerStatus:
    return PositionerStatus(Mode.ACTIVE, Cause.NONE, Health.GOOD, True, True, fallbacks, refused, learned)


def test_counts_of_the_status_go_on_beyond_256_and_begin_anew_after_a_silence(tmp_path: Path) -> None:
    (configuration,) = configured(tmp_path)
    codec, model = configuration.make_codec(), ValveModel(configuration)
    shown = []
    for number in range(40):
        now_ns = number * 100_000_000
        model.add(codec.encode(status(200 + 30 * number & 255, 255 * number & 255), number), now_ns)
        shown.append(dict(model.copy().view(now_ns).counters or ()))
    assert [each["learned"] for each in shown] == [200 + 30 * number for number in range(40)]
    assert [each["refused"] for each in shown] == [255 * number for number in range(40)]
    assert {each["fallbacks"] for each in shown} == {0}
    model.add(codec.encode(status(7), 40), 40 * 100_000_000 + 600_000_000)
    assert dict(model.view(4_600_000_000).counters or ())["learned"] == 7, "it was started again"
