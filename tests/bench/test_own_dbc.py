"""A DBC of the user's, rehearsed: bench and emulator over its frames give our figures within its quantisation."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from plant_emulator.cli.main import main as plant_emulator
from positioner.bench import metrics
from positioner.bench.inprocess import configure, run_in_process
from positioner.bench.modes import mode_spans
from positioner.bench.scenario import Scenario, load_scenario
from positioner.bus.address import embedded_address
from positioner.cli.main import main
from positioner.errors import ConfigurationError, ExitCode
from positioner.wire.file import wire_codec, wire_table
from positioner.wire.messages import CurrentCommand, Mode, StemPosition

if TYPE_CHECKING:
    from collections.abc import Mapping

    from positioner.bench.inprocess import InProcessRun

    Output = pytest.CaptureFixture[str]

PERCENT = Path(__file__).parents[2] / "examples" / "percent.toml"
STEP_OF_SPAN = 2.5e-5
SHORT = """
name = "short"
title = "three moves"
law = "nmpc"
sample_period_s = 0.001
setpoint_period_s = 0.01
setpoints_mm = [73.0, 87.0, 80.0]
dwell_s = 0.2
[plant]
preset = "paper"
[plant.sensor]
noise_of_reading = 0.0
[estimator]
noise_of_reading = 0.0
"""
BARE_DBC = """VERSION ""
NS_ :
BS_:
BU_: PLC VALVE
BO_ 513 Where: 2 VALVE
 SG_ Travel : 7|16@0+ (0.0025,0) [0|100] "%" PLC
BO_ 514 Drive: 3 PLC
 SG_ Demand : 15|16@0+ (0.0025,0) [0|100] "%" VALVE
BO_ 515 Wanted: 4 PLC
 SG_ Target : 0|32@1- (1,0) [0|0] "mm" VALVE
SIG_VALTYPE_ 515 Target : 1;
"""
BARE = """
[wire]
dbc = "bare.dbc"
[wire.stem_position]
message = "Where"
signals = { position_m = "Travel" }
[wire.current_command]
message = "Drive"
signals = { current_ma = "Demand" }
[wire.setpoint]
message = "Wanted"
signals = { setpoint_m = "Target" }
"""


@pytest.fixture
def bare(tmp_path: Path) -> Path:
    """The configuration of a bus without a counter, an echo, a checksum, a quality or a request."""
    (tmp_path / "bare.dbc").write_text(BARE_DBC, "ascii")
    (tmp_path / "bare.toml").write_text(BARE, "ascii")
    return tmp_path / "bare.toml"


def short(folder: Path, *, dwell_s: float = 0.2, wire: Path | None = None) -> Scenario:
    (folder / "short.toml").write_text(SHORT.replace("dwell_s = 0.2", f"dwell_s = {dwell_s}"), "utf-8")
    scenario = load_scenario(str(folder / "short.toml"))
    return replace(scenario, wire=wire_table(wire)) if wire else scenario


def errors_of(run: InProcessRun, scenario: Scenario) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Return the mean error of each dwell, as a part of the span."""
    dwells = metrics.dwell_metrics(run.recording.trace, scenario.dwell_edges_s, 0.127)
    return np.array([dwell.mean_abs_error_pct / 100.0 for dwell in dwells])


@pytest.mark.parametrize("with_counters", [True, False])
def test_a_bench_over_a_percent_dbc_gives_our_figures_within_its_quantisation(
    with_counters: bool, bare: Path, tmp_path: Path
) -> None:
    ours, theirs = short(tmp_path), short(tmp_path, wire=PERCENT if with_counters else bare)
    own, foreign = run_in_process(ours), run_in_process(theirs)
    steps = foreign.recording.measured_m / (STEP_OF_SPAN * 0.127)
    assert np.abs(steps - np.rint(steps)).max() < 1e-6
    fine = own.recording.measured_m / (STEP_OF_SPAN * 0.127)
    assert np.abs(fine - np.rint(fine)).max() > 0.3  # ours has steps of 10 nm: the quantisation is the DBC's
    difference = errors_of(foreign, theirs) - errors_of(own, ours)
    assert 0.0 < np.abs(difference).max() < 12 * STEP_OF_SPAN
    assert errors_of(own, ours).max() < 5e-4
    # within half a step of the truth, which the emulator sends in a frame of ours
    gap_m = np.abs(foreign.recording.measured_m - foreign.recording.true_position_m)
    assert 0.4 * STEP_OF_SPAN * 0.127 < gap_m.max() < 0.51 * STEP_OF_SPAN * 0.127
    foreign.recording.read_modes()
    spans = mode_spans(foreign.recording.mode_reports, theirs.duration_s, 0.1)
    assert {span.mode for span in spans} == {Mode.ACTIVE}


@pytest.mark.bus
def test_the_command_plays_frames_without_counters_on_a_bus_as_in_memory(
    bare: Path, tmp_path: Path, capsys: Output
) -> None:
    scenario = short(tmp_path, dwell_s=0.06, wire=bare)
    run_in_process(scenario).recording.write_log(tmp_path / "memory.log")
    bus, out = str(embedded_address(87)), tmp_path / "out"
    words = ["bench", "--scenario", str(tmp_path / "short.toml"), "--wire", str(bare), "--bus", bus, "--out", str(out)]
    assert main(words) == ExitCode.OK
    assert (out / "bus.log").read_bytes() == (tmp_path / "memory.log").read_bytes()
    assert {span["mode"] for span in json.loads((out / "result.json").read_text("utf-8"))["modes"]} == {"ACTIVE"}
    assert main(["replay", str(out / "bus.log"), "--config", str(out / "valve.toml")]) == ExitCode.OK
    assert "Drive: 180 recorded, 180 computed, 180 equal to the bit" in capsys.readouterr().out


def test_the_wire_table_of_a_scenario_has_its_dbc_beside_it(bare: Path) -> None:
    path = bare.with_name("own.toml")
    path.write_text(SHORT + BARE, "utf-8")
    codec = configure(load_scenario(str(path))).make_codec()
    assert codec.identifier(StemPosition) == (513, False)
    assert codec.identifier(CurrentCommand) == (514, False)


def test_one_of_several_valves_is_named(tmp_path: Path, bare: Path) -> None:
    text = BARE + '[[valve]]\nid = "A"\n[valve.wire]\nid_offset = 128\n[[valve]]\nid = "B"\nwire.id_offset = 256\n'
    bare.write_text(text, "ascii")
    assert [wire_table(bare, name)["id_offset"] for name in "AB"] == [128, 256]
    assert wire_codec(bare, "B").identifier(StemPosition) == (513, False)
    assert wire_table(bare, "A")["dbc"] == str(tmp_path / "bare.dbc")


MISTAKES: Mapping[str, tuple[str, str, str]] = {
    "missing signal": (
        '"Travel" }',
        '"Traval" }',
        "line 6: wire.stem_position.signals.position_m = 'Traval': is not in",
    ),
    "missing message": (
        '"Drive"',
        '"Drove"',
        "line 8: wire.current_command.message = 'Drove': is not in the DBC, which",
    ),
    "wrong unit": (
        '[0|100] "%" PLC',
        '[0|100] "bar" PLC',
        "'Travel': has the unit 'bar', which does not fit position_m",
    ),
    "too narrow": (
        "Travel : 7|16@0+ (0.0025,0) [0|100]",
        "Travel : 7|16@0+ (0.0025,0) [0|90]",
        "'Travel': carries -0.00079375 to 114.301 mm, too little for the stem, which goes from 0 to 127 mm: widen its",
    ),
    "clash": ("BO_ 513 Where", "BO_ 514 Where", "gives the identifier 202 to Where and to Drive"),
    "clash with ours": ("BO_ 513 Where", "BO_ 320 Where", "Where and POSITIONER_STATUS share the identifier 140"),
    "no file": ('"bare.dbc"', '"bear.dbc"', "bear.dbc': cannot be read: No such file or directory"),
    "unknown key": ("[wire.setpoint]", "[wire.setpiont]", "wire.setpiont: unknown key; did you mean 'setpoint'?"),
    "no table": (
        "[wire",
        "[wires",
        "[wire]: is missing: it names the DBC, the messages and the signals; see docs/own-",
    ),
}


@pytest.mark.parametrize("program", ["plant-emulator", "bench", "check"])
@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_one_line_of_the_users_file(mistake: str, program: str, bare: Path, capsys: Output) -> None:
    old, new, text = MISTAKES[mistake]
    for path in (bare, bare.with_name("bare.dbc")):
        path.write_text(path.read_text("ascii").replace(old, new), "ascii")
    if program == "plant-emulator":
        status = plant_emulator(["run", "--bus", "virtual:x", "--wire", str(bare)])
    elif program == "bench":
        words = ["--bus", "virtual:x", "--out", str(bare.parent / "out"), "--wire", str(bare)]
        status = main(["bench", *words])
    else:
        valve = bare.with_name("valve.toml")
        valve.write_text(bare.read_text("ascii") + '[valve]\nid = "V"\npreset = "paper"\n', "ascii")
        if mistake == "no table":
            text = "wires: unknown key; did you mean 'wire'?"
        status = main(["check", str(valve)])
    assert status == ExitCode.CONFIG
    error = capsys.readouterr().err
    assert text in error
    assert error.count("positioner: ") + error.count("plant-emulator: ") == 1
    assert len(error.splitlines()) == 1 or error.startswith("bus virtual:x\n")


def test_a_setpoint_that_the_dbc_cannot_carry_is_refused_at_the_start(bare: Path, tmp_path: Path) -> None:
    dbc = bare.with_name("bare.dbc")
    narrow = '(0.1,0) [0|80] "mm"'
    dbc.write_text(
        BARE_DBC.replace('0|32@1- (1,0) [0|0] "mm"', f"0|32@1- {narrow}").partition("SIG_VALTYPE_")[0], "ascii"
    )
    with pytest.raises(ConfigurationError, match=r"setpoint 87 mm: does not fit the setpoint frame: Wanted\.Target"):
        run_in_process(short(tmp_path, wire=bare))


def test_an_echo_that_is_narrower_than_its_counter_is_refused(tmp_path: Path, capsys: Output) -> None:
    text = PERCENT.with_suffix(".dbc").read_text("ascii")
    short_echo = text.replace("DemandAlive : 19|4@0+ (1,0) [0|15]", "DemandAlive : 19|4@0+ (1,0) [0|7]")
    (tmp_path / "percent.dbc").write_text(short_echo, "ascii")
    (tmp_path / "percent.toml").write_text(PERCENT.read_text("utf-8"), "utf-8")
    assert main(["check", str(tmp_path / "percent.toml")]) == ExitCode.CONFIG
    expected = "'DemandAlive': ends at 7, and the counter of ValveDemand goes to 15: an echo needs as many values"
    assert expected in capsys.readouterr().err


@pytest.mark.parametrize("program", [plant_emulator, main])
def test_a_valve_without_its_file_is_a_wrong_command_line(program: object, capsys: Output) -> None:
    words = ["run", "--valve", "A"] if program is plant_emulator else ["bench", "--valve", "A"]
    assert callable(program)
    assert program(words) == ExitCode.USAGE
    assert "--valve names a valve of the file that --wire gives: give both" in capsys.readouterr().err
