"""The bands of the modes: every kind is named once at least, and names do not cover each other."""

from __future__ import annotations

from itertools import combinations

from positioner.bench.mode_bands import bands_of
from positioner.bench.modes import ModeSpan
from positioner.pictures.bands import NARROWEST_LABEL, Band, draw_bands, labelled
from positioner.pictures.panels import new_figure
from positioner.wire.messages import Cause, Mode


def hold(begin: float, end: float) -> Band:
    return Band(begin, end, "HOLD", "HOLD: setpoint stale")


def test_a_short_failure_is_named_and_a_short_start_is_not() -> None:
    start = Band(0.0, 0.001, "READY", "READY: waiting for arm", notable=False)
    failed = Band(5.0, 5.001, "FAILSAFE", "FAILSAFE: feedback stale")
    assert labelled([start, failed], 0.0, 10.0) == [failed]
    assert labelled([Band(0.0, 1.0, "READY", "READY: waiting for arm", notable=False)], 0.0, 10.0)


def test_of_many_bands_one_of_each_kind_is_named_first_and_no_name_covers_another() -> None:
    bands = [hold(0.1 * number, 0.1 * number + 0.01) for number in range(90)]
    other = Band(4.6205, 4.6206, "FAILSAFE", "FAILSAFE: feedback stale")
    found = labelled([*bands, other], 0.0, 10.0)
    assert found[0].mode == "HOLD"
    assert other in found
    gaps = [abs(one.begin - another.begin) for one, another in combinations(found, 2)]
    assert min(gaps) >= NARROWEST_LABEL * 10.0


def test_a_band_is_shaded_in_every_panel_and_named_in_the_first_one() -> None:
    figure = new_figure(4.0)
    panels = figure.subplots(2, 1)
    draw_bands(panels, [hold(1.0, 2.0)], 0.0, 10.0)
    assert [len(panel.patches) for panel in panels] == [1, 1]
    assert [[text.get_text() for text in panel.texts] for panel in panels] == [["HOLD: setpoint stale"], []]


def test_the_modes_of_a_run_become_bands_and_normal_ones_do_not() -> None:
    spans = (
        ModeSpan(Mode.READY, Cause.WAITING_FOR_ARM, 0.0, 0.1),
        ModeSpan(Mode.ACTIVE, Cause.NONE, 0.1, 1.0),
        ModeSpan(Mode.HOLD, Cause.FEEDBACK_STALE, 1.0, 1.1),
        ModeSpan(None, None, 1.1, 2.0),
    )
    found = [(band.words, band.notable) for band in bands_of(spans)]
    assert found == [
        ("READY: waiting for arm", False),
        ("HOLD: feedback stale", True),
        ("SILENT: cause unknown", True),
    ]
